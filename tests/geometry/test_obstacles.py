"""Scenes as arrays: padded, joined, picked from a batch, and turned into the device's
primitives."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from drpbench.geometry import BOX, Obstacles, signed_distance, stacked


def scene(count, seed=0):
    """Random obstacles of all kinds."""
    rng = np.random.default_rng(seed)
    return Obstacles.of(
        rng.integers(0, 3, count, np.int32),
        rng.uniform(0.05, 0.2, (count, 3)).astype(np.float32),
        rng.uniform(-1, 1, (count, 3)).astype(np.float32),
        Rotation.random(count, rng=rng).as_quat(scalar_first=True).astype(np.float32),
    )


def same(a, b):
    return all(
        np.array_equal(x, y) and x.dtype == y.dtype
        for x, y in zip(jax.tree.leaves(a), jax.tree.leaves(b), strict=True)
    )


def test_slots_without_an_obstacle_are_proper_boxes():
    empty = Obstacles.absent(2, 3)
    assert empty.mask.shape == (2, 3) and not empty.mask.any()
    assert np.all(empty.kind == BOX) and np.all(empty.half_size > 0.0)
    np.testing.assert_array_equal(
        empty.primitives().rotation, np.broadcast_to(np.eye(3), (2, 3, 3, 3))
    )


def test_what_is_padded_holds_the_same_obstacles():
    few = scene(4)
    many = few.padded(9)
    assert many.count == 9 and many.mask.sum() == 4
    assert same(many.present(), few)
    assert same(few.padded(4), few)
    with pytest.raises(ValueError, match="4 obstacles do not fit 3 slots"):
        few.padded(3)
    points = jnp.asarray(np.random.default_rng(1).uniform(-1, 1, (50, 3)), jnp.float32)
    np.testing.assert_array_equal(
        signed_distance(points, few.primitives()), signed_distance(points, many.primitives())
    )


def test_scenes_are_stacked_and_picked_again():
    scenes = [scene(n, seed=n).padded(6) for n in (2, 4, 6)]
    batch = stacked(scenes)
    assert batch.kind.shape == (3, 6)
    for index, one in enumerate(scenes):
        assert same(batch[index], one)
    assert same(batch[[2, 0]], stacked([scenes[2], scenes[0]]))
    assert batch.padded(8).mask.shape == (3, 8)


def test_joining_keeps_the_first_ones_indices():
    both = scene(2, seed=1).joined(scene(3, seed=2))
    assert both.count == 5 and same(both[:2], scene(2, seed=1)) and same(both[2:], scene(3, seed=2))


def test_quaternions_become_rotation_matrices():
    turned = scene(20).primitives().rotation
    expected = Rotation.from_quat(scene(20).quaternion, scalar_first=True).as_matrix()
    np.testing.assert_allclose(turned, expected, atol=1e-6)


def test_the_host_s_primitives_are_numpy_and_float32():
    double = Obstacles.boxes(np.full((1, 3), 0.1), np.zeros((1, 3)), np.array([[1.0, 0, 0, 0]]))
    for leaf in jax.tree.leaves(double.primitives()):
        assert isinstance(leaf, np.ndarray) and leaf.dtype in (np.float32, np.int32, np.bool_)


def test_inside_jit_obstacles_are_traced():
    batch = stacked([scene(3, seed=1), scene(3, seed=2)])
    compiled = jax.jit(jax.vmap(lambda one: one.primitives().rotation))
    np.testing.assert_allclose(
        compiled(jax.tree.map(jnp.asarray, batch)), batch.primitives().rotation, atol=1e-6
    )
