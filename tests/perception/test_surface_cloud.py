"""The scene's points: on the surfaces they claim to be on, and the same ones from step to step."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from drpbench.compile import jit
from drpbench.contract import ROBOT_POINTS, SCENE_POINTS, Movers
from drpbench.geometry import BOX, CYLINDER, SPHERE, Primitives, signed_distance
from drpbench.perception.surface_cloud import (
    Cloud,
    on_box,
    sample_static,
    scene_cloud,
    shares,
)
from drpbench.robot import PANDA

MOVERS = 3


@pytest.fixture(scope="module")
def sampled():
    """`sample_static` of 500 points from six primitives."""
    return jit(lambda key, obstacles: sample_static(key, obstacles, 500))


@pytest.fixture(scope="module")
def observed():
    return jit(scene_cloud)


@jit
def gaps(points, obstacles):
    """|distance| [m] (K, N) of points to the surface of each primitive, masked ones included."""
    alone = jnp.eye(obstacles.count, dtype=bool)
    to_one = jax.vmap(lambda mask: signed_distance(points, replace(obstacles, mask=mask)))
    return jnp.abs(to_one(alone))


def furniture(seed=0):
    """Two boxes, cylinders and spheres in the air, the last one masked."""
    rng = np.random.default_rng(seed)
    kind = np.array([BOX, CYLINDER, SPHERE, BOX, CYLINDER, SPHERE], np.int32)
    half_size = rng.uniform(0.03, 0.2, (6, 3))
    half_size[kind != BOX, 1] = half_size[kind != BOX, 0]
    half_size[kind == SPHERE, 2] = half_size[kind == SPHERE, 0]
    return Primitives(
        kind=kind,
        half_size=half_size.astype(np.float32),
        position=(rng.uniform(-0.5, 0.5, (6, 3)) + [0.0, 0.0, 1.0]).astype(np.float32),
        rotation=Rotation.random(6, rng=rng).as_matrix().astype(np.float32),
        mask=np.arange(6) < 5,
    )


def moving(seed=0, height=1.0, active=(True, True, True)):
    rng = np.random.default_rng(seed)
    offset = np.array([0.0, 0.0, height])
    return Movers(
        half_size=jnp.asarray(rng.uniform(0.05, 0.15, (MOVERS, 3)), jnp.float32),
        rotation=jnp.asarray(Rotation.random(MOVERS, rng=rng).as_matrix(), jnp.float32),
        position=jnp.asarray(rng.uniform(-0.5, 0.5, (MOVERS, 3)) + offset, jnp.float32),
        velocity=jnp.asarray(rng.uniform(-2e-3, 2e-3, (MOVERS, 3)), jnp.float32),
        active=jnp.asarray(active),
    )


def drawn(seed=0):
    static, each = shares(MOVERS)
    keys = jax.random.split(jax.random.key(seed), 2)
    return Cloud(
        jax.random.uniform(keys[0], (static, 3)),
        jnp.arange(static) % 7 > 0,
        jax.random.uniform(keys[1], (MOVERS, each, 3)),
    )


def of_box(array, m):
    """The part of a cloud's array that belongs to box `m`."""
    static, each = shares(MOVERS)
    return np.asarray(array)[static + m * each : static + (m + 1) * each]


def from_surfaces(points, movers):
    """Largest distance [m] of the points of each box to its surface."""
    found = np.asarray(gaps(points, movers.primitives()))
    return [of_box(found[m], m).max() for m in range(MOVERS)]


@pytest.mark.parametrize("movers", range(6))
def test_shares_add_up_and_are_those_of_the_reference(movers):
    static, each = shares(movers)
    assert static + movers * each == SCENE_POINTS
    if movers:
        assert each / static == pytest.approx(1000 / 2048, rel=1e-2)


def test_static_points_lie_on_the_surfaces_that_are_there(sampled):
    obstacles = furniture()
    points, mask = (np.asarray(a) for a in sampled(jax.random.key(0), obstacles))
    assert mask.all()
    found = np.asarray(gaps(points, obstacles))[:5]
    assert found.min(axis=0).max() < 1e-6
    assert set(found.argmin(axis=0)) == set(range(5))
    np.testing.assert_array_equal(points, sampled(jax.random.key(0), obstacles)[0])
    assert np.abs(points - sampled(jax.random.key(1), obstacles)[0]).max() > 0.01


def test_static_points_below_the_table_are_left_out(sampled):
    above = furniture()
    at_zero = replace(above, position=above.position * np.float32([1.0, 1.0, 0.0]))
    points, mask = (np.asarray(a) for a in sampled(jax.random.key(2), at_zero))
    assert points[:, 2].min() >= -1e-6
    # Half of each surface is above; twice as many are drawn as are asked for.
    assert 400 < mask.sum() <= 500
    np.testing.assert_array_equal(points[~mask], 0.0)
    sunk = replace(at_zero, position=at_zero.position - np.float32([0.0, 0.0, 1.0]))
    points, mask = (np.asarray(a) for a in sampled(jax.random.key(2), sunk))
    assert not mask.any() and not points.any()


@pytest.mark.slow
def test_without_a_ground_nothing_is_left_out():
    sunk = furniture()
    sunk = replace(sunk, position=sunk.position - np.float32([0.0, 0.0, 3.0]))
    points, mask = (np.asarray(a) for a in sample_static(jax.random.key(2), sunk, 500, False))
    assert mask.all() and points[:, 2].max() < 0.0
    assert np.asarray(gaps(jnp.asarray(points), sunk))[:5].min(axis=0).max() < 1e-6
    boxes = moving(height=-2.0)
    shown, seen = scene_cloud(drawn(), boxes, ground=False)
    assert of_box(seen, 0).all() and of_box(shown, 0)[:, 2].max() < 0.0
    assert not of_box(scene_cloud(drawn(), boxes)[1], 0).any()


def test_an_empty_scene_has_no_points(sampled):
    obstacles = furniture()
    nothing = replace(obstacles, mask=np.zeros(6, bool))
    points, mask = (np.asarray(a) for a in sampled(jax.random.key(0), nothing))
    assert not mask.any() and not points.any()


def test_points_on_a_box_are_uniform_over_its_faces():
    half = np.array([0.05, 0.1, 0.2], np.float32)
    tickets = np.random.default_rng(0).random((40_000, 3), np.float32)
    points = np.asarray(jit(on_box)(tickets, half))
    relative = np.abs(points) / half
    assert relative.max() <= 1.0 + 1e-6
    face = relative.argmax(axis=1)
    np.testing.assert_allclose(relative.max(axis=1), 1.0, atol=1e-6)
    area = np.array([half[1] * half[2], half[0] * half[2], half[0] * half[1]])
    for axis in range(3):
        for side in (-1.0, 1.0):
            here = points[(face == axis) & (np.sign(points[:, axis]) == side)]
            share = 0.5 * area[axis] / area.sum()
            spread = np.sqrt(share * (1.0 - share) / len(points))
            assert abs(len(here) / len(points) - share) < 5.0 * spread
            # Uniform over the face: second moments of a uniform distribution are h^2 / 3.
            for other in {0, 1, 2} - {axis}:
                assert np.abs(here[:, other].mean()) < 0.05 * half[other]
                assert np.mean(here[:, other] ** 2) == pytest.approx(half[other] ** 2 / 3, rel=0.06)


def test_each_box_has_its_own_points_on_its_surface(observed):
    movers = moving()
    points, mask = observed(drawn(), movers)
    assert points.shape == (SCENE_POINTS, 3) and mask.shape == (SCENE_POINTS,)
    for m in range(MOVERS):
        assert of_box(mask, m).all()
    assert max(from_surfaces(points, movers)) < 1e-6


def test_points_move_with_their_box_and_others_stay_to_the_bit(observed):
    cloud, movers = drawn(), moving()
    position = movers.position + movers.velocity * jnp.array([[1.0], [0.0], [1.0]])
    before = np.asarray(observed(cloud, movers)[0])
    after = np.asarray(observed(cloud, replace(movers, position=position))[0])
    static, _ = shares(MOVERS)
    np.testing.assert_array_equal(after[:static], before[:static])
    np.testing.assert_array_equal(of_box(after, 1), of_box(before, 1))
    for m in (0, 2):
        step = np.asarray(position[m], float) - np.asarray(movers.position[m], float)
        moved = of_box(after, m).astype(float) - of_box(before, m)
        np.testing.assert_allclose(moved, np.tile(step, (len(moved), 1)), atol=3e-7)


def test_what_is_inactive_or_below_the_table_has_no_points(observed):
    cloud = drawn()
    points, mask = observed(cloud, moving(active=(True, False, True)))
    assert of_box(mask, 0).all() and of_box(mask, 2).all()
    assert not of_box(mask, 1).any() and not of_box(points, 1).any()
    points, mask = (np.asarray(a) for a in observed(cloud, moving(height=0.0)))
    static, _ = shares(MOVERS)
    on_boxes, seen = points[static:], mask[static:]
    assert 0 < seen.sum() < seen.size
    assert on_boxes[seen, 2].min() >= 0.0
    np.testing.assert_array_equal(on_boxes[~seen], 0.0)
    np.testing.assert_array_equal(mask[:static], cloud.static_mask)


def test_the_cloud_of_a_box_that_changes_size_is_on_the_new_box(observed):
    cloud, small, large = drawn(), moving(0), moving(1)
    grown = replace(small, half_size=large.half_size, rotation=large.rotation)
    points, _ = observed(cloud, grown)
    assert max(from_surfaces(points, grown)) < 1e-6
    assert max(from_surfaces(points, small)) > 0.01


def test_the_arm_shows_256_points_of_every_moving_link():
    points = PANDA.surface_points(ROBOT_POINTS)
    assert points.count == ROBOT_POINTS
    assert len(np.unique(points.local, axis=0)) == ROBOT_POINTS
    assert {PANDA.link_names[i] for i in points.link} == set(PANDA.link_names[1:])
