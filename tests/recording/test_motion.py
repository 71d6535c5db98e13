"""What is worked out again from recorded joints is what the world saw."""

from dataclasses import replace

import numpy as np
import pytest

from drpbench.recording import RecordingError, episode, motion
from drpbench.recording.episode import nanoseconds
from drpbench.robot import PANDA


def test_an_instant_is_a_sixtieth_of_a_second_without_drift():
    assert nanoseconds(0) == 0 and nanoseconds(60) == 10**9 and nanoseconds(1000) == 16_666_666_666
    steps = np.diff([nanoseconds(k) for k in range(1001)])
    assert set(steps) == {16_666_666, 16_666_667}


def test_clearance_errors_and_collisions_are_those_of_the_trace(rolled):
    trace = rolled.trace
    for b, (found, row) in enumerate(zip(rolled.episodes, rolled.rows, strict=True)):
        seen = motion(found)
        np.testing.assert_allclose(seen.clearance[1:], trace.clearance[:, b], atol=1e-5)
        np.testing.assert_allclose(seen.grip_position[1:], trace.grip_position[:, b], atol=1e-5)
        np.testing.assert_allclose(seen.position_error[1:], trace.position_error[:, b], atol=1e-5)
        np.testing.assert_allclose(
            np.cos(seen.orientation_error[1:]), np.cos(trace.orientation_error[:, b]), atol=1e-5
        )
        assert seen.touching.any() == row.collided
        if row.collided:
            assert seen.touching.argmax() == row.first_collision_step + 1
            assert seen.touched(row.first_collision_step + 1) == row.first_collision_link
    assert any(row.collided for row in rolled.rows)


def test_the_contact_point_is_on_the_obstacle_beside_the_link(rolled):
    """A sphere of the arm is at most 8 cm across, so its link's frame is not far from what it
    touches."""
    for found in rolled.episodes:
        seen = motion(found)
        for instant in np.flatnonzero(seen.touching):
            frame = PANDA.links[seen.link[instant]].frame
            assert (
                np.linalg.norm(seen.contact_point[instant] - seen.link_position[instant, frame])
                < 0.4
            )


def test_nothing_depends_on_whether_the_nearest_sphere_was_recorded(rolled):
    for found in rolled.episodes:
        recorded, searched = motion(found), motion(replace(found, sphere=None))
        np.testing.assert_allclose(searched.clearance, recorded.clearance, atol=1e-5)
        np.testing.assert_array_equal(searched.touching, recorded.touching)
        same = searched.link == recorded.link
        assert same[recorded.touching].all() and same.mean() > 0.99
        np.testing.assert_allclose(
            searched.contact_point[recorded.touching],
            recorded.contact_point[recorded.touching],
            atol=1e-4,
        )


def test_boxes_stand_at_the_start_where_the_task_puts_them(rolled):
    for b, found in enumerate(rolled.episodes):
        np.testing.assert_array_equal(found.boxes.position[1:], rolled.trace.mover_position[:, b])
        step = np.linalg.norm(found.boxes.position[1] - found.boxes.position[0], axis=-1)
        assert (step[found.boxes.active[0]] < 0.0031).all() and found.boxes.active[0].any()


def _arrays(rolled):
    arrays = {
        "joint_position": np.concatenate(
            [rolled.trace.start[None, 0], rolled.trace.joint_position[:, 0]]
        ),
        "joint_velocity": rolled.trace.joint_velocity[:, 0],
    }
    for field in ("position", "active", "half_size", "rotation"):
        arrays[f"mover_{field}"] = getattr(rolled.trace, f"mover_{field}")[:, 0]
    return arrays


def test_an_episode_that_stops_being_finite_ends_before(rolled):
    arrays = _arrays(rolled)
    arrays["joint_position"] = arrays["joint_position"].copy()
    arrays["joint_position"][500:] = np.nan
    found = episode(rolled.trace.world, rolled.ids[0], rolled.problems, rolled.seed, arrays)
    assert found.instants == 500 and len(found.boxes.active) == 500
    assert np.isfinite(motion(found).clearance).all()


@pytest.mark.parametrize(
    ("damage", "said"),
    [
        (lambda a: a.pop("mover_active"), "lacks mover_active"),
        (lambda a: a.update(joint_velocity=a["joint_velocity"][:-1]), "not of one number of steps"),
        (lambda a: a.update(mover_position=a["mover_position"][:, :1]), "not of one number"),
        (lambda a: a.update(joint_position=a["joint_position"] + 0.1), "does not begin where"),
    ],
)
def test_damaged_recordings_are_refused(rolled, damage, said):
    arrays = _arrays(rolled)
    damage(arrays)
    with pytest.raises(RecordingError, match=said):
        episode(rolled.trace.world, rolled.ids[0], rolled.problems, rolled.seed, arrays)
