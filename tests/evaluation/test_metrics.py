"""Rows from episodes written by hand."""

import math
from dataclasses import replace

import numpy as np
import pytest

from drpbench.contract import EPISODE
from drpbench.envs import TASKS, World
from drpbench.evaluation.metrics import rows, sparc
from drpbench.geometry import FAR
from drpbench.results import Row
from drpbench.robot import PANDA
from drpbench.rollout import Trace

STEPS = 100
FINGER = int(np.argmax(PANDA.moving_spheres.link == PANDA.link_names.index("left_finger")))
FOREARM = int(np.argmax(PANDA.moving_spheres.link == PANDA.link_names.index("link5")))


def trace(task="FDO", **changed):
    """One arm that never moves, at its goal, 10 cm from everything; changed as told, (T, ...)
    arrays."""
    still = {
        "joint_position": np.tile(PANDA.home, (STEPS, 1)),
        "joint_velocity": np.zeros((STEPS, 7)),
        "grip_position": np.tile([0.5, 0.0, 0.4], (STEPS, 1)),
        "position_error": np.zeros(STEPS),
        "orientation_error": np.zeros(STEPS),
        "clearance": np.full(STEPS, 0.1),
        "sphere": np.zeros(STEPS, int),
        "self_clearance": np.full(STEPS, 0.05),
        "finite": np.ones(STEPS, bool),
        "mover_position": np.zeros((STEPS, 0, 3)),
        "mover_active": np.zeros((STEPS, 0), bool),
        "mover_half_size": np.zeros((STEPS, 0, 3)),
        "mover_rotation": np.zeros((STEPS, 0, 3, 3)),
    }
    once = {
        "start": PANDA.home,
        "start_grip": np.array([0.5, 0.0, 0.4]),
        "valid": np.bool_(True),
    }
    assert set(changed) <= set(still) | set(once)
    over_time = {name: np.asarray(changed.get(name, a))[:, None] for name, a in still.items()}
    at_once = {name: np.asarray(changed.get(name, a))[None] for name, a in once.items()}
    return Trace(world=World(TASKS[task]), **over_time, **at_once, failures=("",))


def row(**changed):
    (found,) = rows([7], ["box"], trace(**changed))
    assert Row.model_validate_json(found.model_dump_json()) == found
    return found


def over_time(**values):
    """An array over the steps from values by first step: over_time(_0=1.0, _50=2.0)."""
    found = np.empty(STEPS)
    for first, value in values.items():
        found[int(first[1:]) :] = value
    return found


def test_an_arm_that_rests_at_its_goal():
    found = row()
    assert (found.id, found.task, found.family, found.status, found.valid) == (
        7,
        "FDO",
        "box",
        "ok",
        True,
    )
    assert found.success and found.reached and found.reached_5cm and found.reached_once
    assert not (found.collided or found.self_collided or found.joint_limit_violation)
    assert found.first_collision_step is None and found.first_collision_link is None
    assert found.min_clearance == pytest.approx(0.1)
    assert found.position_error == found.orientation_error == 0.0
    assert found.time_to_goal == pytest.approx(EPISODE.period, rel=1e-5)
    assert found.joint_path_length == found.ee_path_length == 0.0
    assert found.sparc_joint is None and found.sparc_ee is None


@pytest.mark.parametrize(
    ("position", "degrees", "reached", "at_5cm"),
    [
        (0.0099, 14.9, True, True),
        (0.0101, 0.0, False, True),
        (0.0, 15.1, False, False),
        (0.049, 14.9, False, True),
        (0.051, 0.0, False, False),
    ],
)
def test_reached_is_1_cm_and_15_degrees_at_the_last_step(position, degrees, reached, at_5cm):
    found = row(
        position_error=over_time(_0=0.0, _99=position),
        orientation_error=over_time(_0=0.0, _99=math.radians(degrees)),
    )
    assert found.reached is found.success is reached
    assert found.reached_5cm is at_5cm
    assert found.reached_once
    assert found.position_error == pytest.approx(position)
    assert found.orientation_error == pytest.approx(math.radians(degrees), rel=1e-5)
    assert (found.time_to_goal is not None) is reached


def test_reached_once_needs_both_at_the_same_step():
    found = row(
        position_error=over_time(_0=0.0, _50=0.2), orientation_error=over_time(_0=1.0, _50=0.0)
    )
    assert not found.reached_once and not found.reached


def test_time_to_goal_is_from_when_the_goal_stays_reached():
    errors = over_time(_0=0.5, _20=0.001, _30=0.02, _40=0.001)
    found = row(position_error=errors)
    # The 41st step, number 40, is the first of those that stay.
    assert found.time_to_goal == pytest.approx(41 * EPISODE.period, rel=1e-5)


def test_the_first_collision_is_named():
    sphere = over_time(_0=0, _30=FINGER, _60=FOREARM).astype(int)
    found = row(clearance=over_time(_0=0.1, _30=-0.002, _32=0.1, _60=-0.01, _61=0.1), sphere=sphere)
    assert found.collided and not found.success and found.reached
    assert found.first_collision_step == 30
    assert found.first_collision_link == "left_finger"
    assert found.min_clearance == pytest.approx(-0.01)


def test_touching_at_zero_is_no_collision():
    assert not row(clearance=over_time(_0=0.0)).collided


def test_self_collision_is_reported_and_no_failure():
    found = row(self_clearance=over_time(_0=0.05, _10=-0.001, _11=0.05))
    assert found.self_collided and found.success


def test_without_obstacles_there_is_no_clearance():
    found = row(clearance=np.full(STEPS, FAR - 0.05))
    assert found.min_clearance is None and not found.collided


def test_path_lengths_begin_at_the_start():
    joints = (
        PANDA.home + np.linspace(0.01, 1.0, STEPS)[:, None] * np.array([3, 0, 4, 0, 0, 0, 0]) / 5.0
    )
    grip = np.array([0.5, 0.0, 0.4]) + np.linspace(0.002, 0.2, STEPS)[:, None] * np.array([0, 1, 0])
    found = row(joint_position=joints, grip_position=grip)
    assert found.joint_path_length == pytest.approx(1.0, rel=1e-5)
    assert found.ee_path_length == pytest.approx(0.2, rel=1e-5)
    back = row(joint_position=np.concatenate([joints[:50], joints[:50][::-1]]))
    assert back.joint_path_length == pytest.approx(0.5 + 0.49, rel=1e-5)


@pytest.mark.parametrize(("beyond", "violated"), [(5e-4, False), (2e-3, True)])
def test_joint_limits_have_a_milliradian_of_tolerance(beyond, violated):
    joints = np.tile(PANDA.home, (STEPS, 1))
    joints[40, 3] = PANDA.joint_upper[3] + beyond
    assert row(joint_position=joints).joint_limit_violation is violated


def test_a_nan_is_a_failed_instance_with_its_reason():
    broken = over_time(_0=0.0, _60=np.nan)
    found = row(
        finite=over_time(_0=1, _60=0).astype(bool),
        position_error=broken,
        orientation_error=broken,
        clearance=over_time(_0=0.1, _60=np.nan),
        joint_position=np.tile(PANDA.home, (STEPS, 1)) + broken[:, None],
        grip_position=np.tile([0.5, 0.0, 0.4], (STEPS, 1)) + broken[:, None],
    )
    assert found.status == "nan"
    assert not (found.success or found.reached or found.reached_5cm or found.collided)
    assert found.position_error is None and found.joint_path_length is None
    assert found.sparc_joint is None and found.time_to_goal is None
    assert found.min_clearance == pytest.approx(0.1)


def test_a_policy_that_answered_nan_once_has_failed_even_at_the_goal():
    finite = np.ones(STEPS, bool)
    finite[3] = False
    found = row(finite=finite)
    assert found.status == "nan" and not found.reached and not found.success
    assert found.position_error == 0.0


def test_a_nan_everywhere_still_gives_a_row():
    gone = np.full(STEPS, np.nan)
    found = row(finite=np.zeros(STEPS, bool), clearance=gone, position_error=gone)
    assert found.status == "nan" and found.min_clearance is None


def test_an_episode_that_was_no_instance_is_marked():
    assert not row(valid=np.bool_(False)).valid


def test_rows_are_in_the_order_of_the_ids():
    near, far = trace("GB"), trace("GB", position_error=np.full(STEPS, 0.3))
    both = Trace(
        world=near.world,
        **{
            name: np.concatenate([value, getattr(far, name)], axis=1 if name in _TIMED else 0)
            for name, value in vars(near).items()
            if name not in ("world", "failures")
        },
        failures=near.failures + ("planner: found no path",),
    )
    first, second = rows([9, 4], ["table", "box"], both)
    assert (first.task, first.id, first.family, first.reached) == ("GB", 9, "table", True)
    assert (second.id, second.family, second.reached) == (4, "box", False)
    assert (first.status, second.status) == ("ok", "planner: found no path")


def test_a_policy_that_failed_never_reached():
    (row,) = rows([9], ["table"], replace(trace(), failures=("raised: ValueError: no",)))
    assert row.status == "raised: ValueError: no"
    assert not row.reached and not row.success and not row.reached_5cm and row.time_to_goal is None


_TIMED = {name for name, value in vars(trace()).items() if np.shape(value)[:1] == (STEPS,)}


def minimum_jerk(seconds, rate=60.0):
    t = np.linspace(0.0, 1.0, round(seconds * rate))
    return 30 * t**2 - 60 * t**3 + 30 * t**4


def test_smoothness_of_the_published_example():
    # The example in the measure's published code: exp(-5 t^2) at 100 Hz.
    t = np.arange(-1.0, 1.0, 0.01)
    assert sparc(np.exp(-5.0 * t**2), 100.0) == pytest.approx(-1.41403, abs=1e-5)


def test_a_minimum_jerk_movement_is_about_as_smooth_as_can_be():
    # A spectrum that falls from 1 to the threshold in a straight line measures -sqrt(1 + 0.95^2).
    for seconds in (1.0, 3.0):
        assert sparc(minimum_jerk(seconds), 60.0) == pytest.approx(-math.hypot(1.0, 0.95), abs=0.03)


def test_a_movement_in_jerks_is_less_smooth():
    smooth = minimum_jerk(2.0)
    jerky = smooth * (1.0 + 0.5 * np.sign(np.sin(np.linspace(0.0, 40.0, smooth.size))))
    halting = np.concatenate([minimum_jerk(0.5), np.zeros(15), minimum_jerk(0.5), np.zeros(15)])
    assert sparc(jerky, 60.0) < sparc(smooth, 60.0) - 0.3
    assert sparc(halting, 60.0) < sparc(smooth, 60.0) - 0.5


def test_smoothness_depends_on_neither_scale_nor_what_follows():
    smooth = minimum_jerk(2.0)
    value = sparc(smooth, 60.0)
    assert sparc(7.0 * smooth, 60.0) == pytest.approx(value, rel=1e-9)
    rested = np.concatenate([smooth, np.zeros(300)])
    assert sparc(rested, 60.0) == pytest.approx(value, rel=0.02)


def test_no_movement_has_no_smoothness():
    assert sparc(np.zeros(100), 60.0) is None
    assert sparc(np.ones(1), 60.0) is None
