"""FDO: where boxes are born, how they drift, and when they go."""

import numpy as np
import pytest

from drpbench.contract import Episode

pytestmark = pytest.mark.slow

CENTER = np.array([0.15, 0.0, 0.5])
COLUMN = 0.25  # [m] from the base's axis to a box's centre, at least


@pytest.fixture(scope="module")
def episodes(lives):
    born, last, (position, velocity, active), valid = lives("FDO")
    return born, np.asarray(position, float), np.asarray(velocity, float), np.asarray(active)


def test_three_boxes_are_born_clear_of_the_arm(episodes, crowd, rooms):
    born = episodes[0]
    assert born.active.shape == (200, 3) and np.asarray(born.active).all()
    assert rooms(born, crowd[1]).min() > 0.01


def test_boxes_are_born_in_the_upper_shell_in_front(episodes):
    born = episodes[0]
    position = np.asarray(born.position, float)
    away = np.linalg.norm(position - CENTER, axis=-1)
    at_half_a_metre = np.isclose(position[..., 0], 0.5, atol=1e-6)
    assert ((away >= 0.8 - 1e-5) & (away <= 1.0 + 1e-5) | at_half_a_metre).all()
    assert position[..., 0].min() >= 0.1
    assert position[..., 2].min() >= CENTER[2] - 1e-6
    assert (np.linalg.norm(position[..., :2], axis=-1) >= COLUMN - 1e-5).all()


def test_edges_are_as_long_as_the_level_says(episodes):
    half = np.asarray(episodes[0].half_size)
    for level, longest in ((1, 0.1), (2, 0.15)):
        here = half[level - 1 :: 2]
        assert 0.05 <= here.min() < 0.055
        assert 0.95 * longest < here.max() <= longest
    rotation = np.asarray(episodes[0].rotation, float)
    unit = np.einsum("...ij,...kj->...ik", rotation, rotation)
    np.testing.assert_allclose(unit, np.broadcast_to(np.eye(3), unit.shape), atol=1e-5)
    # Uniform rotations have no preferred axis: E[R] = 0.
    assert np.abs(rotation.mean(axis=(0, 1))).max() < 0.12


def test_boxes_head_roughly_for_the_centre(episodes):
    born = episodes[0]
    toward = CENTER - np.asarray(born.position, float)
    heading = np.asarray(born.velocity, float)
    cosine = np.sum(toward * heading, axis=-1)
    cosine /= np.linalg.norm(toward, axis=-1) * np.linalg.norm(heading, axis=-1)
    # N(0, 0.2) on each component: two of them turn it, by 0.28 rad (rms).
    assert np.sqrt(np.mean(np.arccos(np.clip(cosine, -1, 1)) ** 2)) == pytest.approx(0.28, abs=0.03)


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


def test_boxes_stay_in_their_region(episodes):
    born, position, _, _ = episodes
    assert np.linalg.norm(position - CENTER, axis=-1).max() <= 1.2 + 1e-5
    assert position[..., 0].min() >= 0.1 - 1e-6
    nearest = np.linalg.norm(position[..., :2], axis=-1).min(axis=1)
    assert (nearest >= COLUMN - 1e-5).all()
    assert nearest.min() < COLUMN + 0.01  # some do come that near


def test_no_box_enters_what_no_policy_can_move_aside(episodes, in_core):
    born, position, _, _ = episodes
    assert in_core(born, position) <= 1e-5


def test_boxes_are_gone_300_steps_before_the_end(episodes):
    active = episodes[3]
    assert active[:, :700].all()
    assert not active[:, 700:].any()


def test_every_key_has_boxes_of_its_own_and_always_the_same(episodes, lives):
    position = np.asarray(episodes[0].position)
    assert len(np.unique(position.reshape(-1, 3), axis=0)) == 600
    np.testing.assert_array_equal(lives("FDO")[0].position, position)
    assert (np.asarray(lives("FDO", seed=1)[0].position) != position).any(axis=(1, 2)).all()


def test_at_another_rate_boxes_are_as_fast_and_go_as_early(lives):
    half_as_often = Episode(steps=500, period=1.0 / 30.0)
    born, _, (_, velocity, active), _ = lives("FDO", episode=half_as_often)
    at_60_hz = lives("FDO")[0]
    np.testing.assert_array_equal(born.position, at_60_hz.position)
    np.testing.assert_allclose(born.velocity, 2.0 * np.asarray(at_60_hz.velocity), rtol=1e-5)
    active = np.asarray(active)
    assert active[:, :350].all() and not active[:, 350:].any()
