"""Which points move, against a KD-tree; which are near the arm, by brute force."""

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial import cKDTree

from drpbench.compile import jit
from drpbench.policies import squared_distances
from drpbench.policies.dynamic_points import NEAR_POINTS, is_dynamic, near_arm, velocity

STILL = 5e-4
CLOUD = 2048


@pytest.fixture(scope="module")
def near():
    return jit(near_arm)


@pytest.fixture(scope="module")
def dynamic():
    return jit(lambda points, before, mask: is_dynamic(points, before, mask, threshold=STILL))


@pytest.fixture(scope="module")
def speed():
    return jit(
        lambda point, before, mask: velocity(point, before, mask, period=1 / 60, farthest=0.02)
    )


def cloud(seed=0, share=0.9):
    """Random points within 1 m, and a mask; masked points are zero."""
    rng = np.random.default_rng(seed)
    mask = rng.random(CLOUD) < share
    points = rng.uniform(-1.0, 1.0, (CLOUD, 3)).astype(np.float32)
    return np.where(mask[:, None], points, np.float32(0.0)), mask


def arm(seed=0):
    rng = np.random.default_rng(seed)
    return (
        rng.uniform(-0.3, 0.3, (20, 3)).astype(np.float32),
        rng.uniform(0.02, 0.08, 20).astype(np.float32),
    )


def to_arm(points, centers, radii):
    away = np.linalg.norm(points[:, None].astype(float) - centers, axis=-1)
    return (away - radii).min(axis=1)


def rows(points):
    return {tuple(p) for p in np.asarray(points).tolist()}


@pytest.mark.parametrize("seed", range(5))
def test_moved_points_are_those_that_a_kd_tree_finds(dynamic, seed):
    before, mask = cloud(seed)
    rng = np.random.default_rng(100 + seed)
    moved = rng.random(CLOUD) < 0.3
    length = rng.choice([0.0, 1e-4, 4e-4, 6e-4, 1e-3, 3e-3, 0.05], CLOUD)
    direction = rng.normal(size=(CLOUD, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    now = before + (moved * length)[:, None] * direction
    asked = now[rng.permutation(CLOUD)[:NEAR_POINTS]].astype(np.float32)
    gap, _ = cKDTree(before[mask].astype(float)).query(asked.astype(float))
    expected = gap > STILL
    sure = np.abs(gap - STILL) > 1e-6
    found = np.asarray(dynamic(asked, before, mask))
    np.testing.assert_array_equal(found[sure], expected[sure])
    assert 0.02 < found.mean() < 0.9


def test_nothing_moves_in_a_cloud_that_is_the_same_to_the_bit(dynamic):
    points, mask = cloud()
    asked = points[mask][:NEAR_POINTS]
    assert not np.asarray(dynamic(asked, points, mask)).any()


def test_without_a_frame_before_nothing_moves(dynamic):
    points, mask = cloud()
    moved = points[mask][:NEAR_POINTS] + np.float32(0.01)
    assert np.asarray(dynamic(moved, points, mask)).all()
    assert not np.asarray(dynamic(moved, points, np.zeros_like(mask))).any()


def test_points_that_are_not_there_do_not_move(dynamic):
    points, mask = cloud()
    asked = np.full((NEAR_POINTS, 3), 1.0e3, np.float32)
    assert not np.asarray(dynamic(asked, points, mask)).any()


def test_velocity_is_the_step_from_the_nearest_point_before(speed):
    before, mask = cloud()
    tree = cKDTree(before[mask].astype(float))
    rng = np.random.default_rng(1)
    for point in before[mask][:20]:
        moved = point + rng.uniform(-2e-3, 2e-3, 3).astype(np.float32)
        _, index = tree.query(moved.astype(float))
        expected = (moved.astype(float) - before[mask][index]) * 60
        np.testing.assert_allclose(speed(moved, before, mask), expected, atol=2e-5)


def test_a_point_that_has_just_appeared_has_no_velocity(speed):
    before, mask = cloud()
    alone = np.float32([3.0, 0.0, 0.0])
    np.testing.assert_array_equal(speed(alone, before, mask), 0.0)
    np.testing.assert_array_equal(speed(before[mask][0], before, np.zeros_like(mask)), 0.0)
    # A masked point at the origin is no neighbour.
    only = np.zeros_like(mask)
    only[0] = True
    first = np.zeros_like(before)
    first[0] = 1.0
    np.testing.assert_array_equal(speed(np.float32([0.001, 0.0, 0.0]), first, only), 0.0)


def test_every_point_within_reach_is_picked_where_all_fit(near):
    points, mask = cloud(3, share=0.3)
    centers, radii = arm()
    found = np.asarray(near(points, mask, centers, radii))
    gap = to_arm(points, centers, radii)
    picked = found[found[:, 0] < 100.0]
    assert 20 < len(picked) <= NEAR_POINTS
    reach = to_arm(picked, centers, radii).max()
    assert rows(picked) <= rows(points[mask])
    assert rows(points[mask & (gap <= reach)]) == rows(picked)
    # One ring farther, 5 cm, would have been too many, or is beyond 0.4 m.
    assert (mask & (gap < reach + 0.05)).sum() > NEAR_POINTS or reach > 0.35


def test_points_far_away_and_masked_ones_are_not_picked(near):
    centers, radii = arm()
    points = np.full((CLOUD, 3), 5.0, np.float32)
    mask = np.ones(CLOUD, bool)
    points[:10], mask[:10] = 0.0, False
    points[7], mask[7] = centers[3] + np.float32([0.0, 0.0, 0.1]), True
    found = np.asarray(near(points, mask, centers, radii))
    assert found.shape == (NEAR_POINTS, 3)
    assert rows(found[found[:, 0] < 100.0]) == {tuple(points[7].tolist())}


def test_when_too_many_touch_the_arm_256_of_the_innermost_ring_are_picked(near):
    rng = np.random.default_rng(0)
    centers, radii = arm()
    points = (centers[rng.integers(20, size=CLOUD)] + rng.normal(0, 0.02, (CLOUD, 3))).astype(
        np.float32
    )
    found = np.asarray(near(points, np.ones(CLOUD, bool), centers, radii))
    assert len(rows(found)) == NEAR_POINTS
    assert to_arm(found, centers, radii).max() < 0.05


def test_squared_distances_are_zero_for_a_point_and_itself():
    points = jnp.asarray(cloud()[0][:50])
    found = np.asarray(squared_distances(points, points))
    np.testing.assert_array_equal(np.diag(found), 0.0)
    gap = points[:, None] - points[None]
    np.testing.assert_allclose(found, np.sum(np.square(gap), axis=-1), rtol=1e-5)
