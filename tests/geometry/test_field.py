"""Primitives as a distance field."""

import jax
import jax.numpy as jnp
import numpy as np

from drpbench.geometry import FAR, Field, nearest, normal, signed_distance

from ..scenes import boxes

SCENE = boxes(((0.5, 0.0, 0.3), (0.1, 0.2, 0.3)), ((-0.4, 0.2, 0.1), (0.1, 0.1, 0.1)), width=4)
POINTS = jnp.asarray(np.random.default_rng(0).uniform(-1.0, 1.0, (200, 3)), jnp.float32)


def test_primitives_are_a_field_of_their_own_distances():
    assert isinstance(SCENE, Field)
    np.testing.assert_array_equal(SCENE.distance(POINTS), signed_distance(POINTS, SCENE))
    distance, direction = SCENE.distance_and_normal(POINTS)
    expected, which = nearest(POINTS, SCENE)
    np.testing.assert_array_equal(distance, expected)
    np.testing.assert_array_equal(direction, normal(POINTS, SCENE, which))


def test_the_normal_is_the_distances_gradient():
    _, direction = SCENE.distance_and_normal(POINTS)
    slope = jax.vmap(jax.grad(lambda point: SCENE.distance(point)))(POINTS)
    np.testing.assert_allclose(direction, slope, atol=1e-5)


def test_nothing_is_far_away():
    distance, direction = boxes(width=0).distance_and_normal(POINTS)
    assert np.all(np.asarray(distance) == FAR) and np.all(np.isfinite(direction))
