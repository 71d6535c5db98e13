"""DGB: boxes that come for an arm that is at its goal."""

import numpy as np
import pytest

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def episodes(lives):
    born, last, (position, velocity, active), valid = lives("DGB")
    return born, np.asarray(position, float), np.asarray(velocity, float), np.asarray(active)


@pytest.fixture(scope="module")
def goals(crowd):
    return crowd[0].goal_position[:, None].astype(float)


def into_column(position):
    """How deep [m] a centre is in the cylinder about the base, 0.6 m high."""
    radial = 0.25 - np.linalg.norm(position[..., :2], axis=-1)
    return np.minimum(radial, 0.6 - position[..., 2])


def test_one_box_or_on_level_2_three(episodes):
    active = np.asarray(episodes[0].active)
    np.testing.assert_array_equal(active[0::2].sum(axis=1), 1)
    np.testing.assert_array_equal(active[1::2].sum(axis=1), 3)


def test_boxes_are_born_clear_of_the_arm_about_its_goal(episodes, crowd, goals, rooms):
    born = episodes[0]
    assert rooms(born, crowd[1]).min() > 0.01
    position = np.asarray(born.position, float)
    away = np.linalg.norm(position - goals, axis=-1)
    assert away.min() >= 0.5 - 1e-5 and away.max() <= 0.6 + 1e-5
    assert (position[..., 2] >= goals[..., 2] - 1e-6).all()
    assert position[..., 0].min() >= 0.15
    assert into_column(position).max() <= 1e-6
    half = np.asarray(born.half_size)
    assert 0.05 <= half.min() < 0.055 and 0.145 < half.max() <= 0.15


def test_boxes_head_for_the_goal(episodes, goals):
    born = episodes[0]
    toward = goals - np.asarray(born.position, float)
    heading = np.asarray(born.velocity, float)
    cosine = np.sum(toward * heading, axis=-1)
    cosine /= np.linalg.norm(toward, axis=-1) * np.linalg.norm(heading, axis=-1)
    # N(0, 0.01) on each component: two of them turn it, by 0.014 rad (rms).
    angle = np.arccos(np.clip(cosine, -1, 1))
    assert np.sqrt(np.mean(angle**2)) == pytest.approx(0.0141, abs=0.0015)


def test_boxes_go_straight_at_1_to_3_mm_a_step_or_turn_back(episodes):
    _, position, velocity, _ = episodes
    speed = np.linalg.norm(velocity, axis=-1)
    assert 0.001 - 1e-7 <= speed.min() < 0.0011 and 0.0029 < speed.max() <= 0.003 + 1e-7
    step = np.diff(position, axis=1)
    turned = (velocity[:, 1:] != velocity[:, :-1]).any(axis=-1)
    assert 0.0 < turned.mean() < 0.01
    np.testing.assert_array_equal(velocity[:, 1:][turned], -velocity[:, :-1][turned])
    np.testing.assert_array_equal(step[turned], 0.0)
    np.testing.assert_allclose(step[~turned], velocity[:, 1:][~turned], atol=2e-7)


def test_boxes_stay_in_their_region(episodes, goals):
    _, position, _, _ = episodes
    assert np.linalg.norm(position - goals[:, None], axis=-1).max() <= 1.0 + 1e-5
    assert position[..., 0].min() >= 0.15 - 1e-6
    deepest = np.stack([into_column(position[:, t]).max() for t in range(0, 1000, 5)])
    assert deepest.max() <= 1e-5


def test_no_box_enters_what_no_policy_can_move_aside(episodes, in_core):
    born, position, _, _ = episodes
    assert in_core(born, position) <= 1e-5


def test_a_box_reaches_a_goal_that_is_not_by_the_base(episodes, goals):
    _, position, _, active = episodes
    away = np.linalg.norm(position - goals[:, None], axis=-1)
    nearest = np.where(active, away, np.inf).min(axis=(1, 2))
    assert (nearest[goals[:, 0, 0] > 0.4] < 0.05).mean() > 0.95


def test_boxes_are_gone_300_steps_before_the_end(episodes):
    active = episodes[3]
    np.testing.assert_array_equal(active[:, :700], np.repeat(active[:, :1], 700, axis=1))
    assert not active[:, 700:].any()
