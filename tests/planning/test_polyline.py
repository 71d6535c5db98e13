"""Points along polylines, by JAX and on the host."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from drpbench.planning import polyline

# Four waypoints of two joints; the steps' lengths are nothing but given.
PATH = np.array([(0.0, 0.0), (1.0, 0.0), (1.0, 2.0), (4.0, 2.0)], np.float32)
STEPS = np.array([1.0, 2.0, 0.5], np.float32)


def test_points_are_at_the_lengths_that_are_asked_for():
    ends = polyline.ends(jnp.asarray(STEPS))
    np.testing.assert_allclose(ends, [0.0, 1.0, 3.0, 3.5])
    found = polyline.along(jnp.asarray(PATH), ends, jnp.array([0.0, 0.5, 1.0, 2.0, 3.25, 3.5]))
    np.testing.assert_allclose(found, [(0, 0), (0.5, 0), (1, 0), (1, 1), (2.5, 2), (4, 2)])


def test_lengths_beyond_the_ends_give_the_ends():
    ends = polyline.ends(jnp.asarray(STEPS))
    found = polyline.along(jnp.asarray(PATH), ends, jnp.array([-1.0, 9.0]))
    np.testing.assert_allclose(found, PATH[[0, -1]])


@pytest.mark.parametrize("count", [2, 8, 33])
def test_host_and_device_walk_alike(count):
    points, whole = jax.jit(polyline.evenly, static_argnums=2)(PATH, STEPS, count)
    assert float(whole) == pytest.approx(STEPS.sum())
    on_host = polyline.evenly_on_host(PATH.astype(float), STEPS.astype(float), count)
    assert on_host.dtype == float
    np.testing.assert_allclose(points, on_host, atol=1e-5)
    np.testing.assert_allclose(on_host[[0, -1]], PATH[[0, -1]])


def test_a_step_without_length_is_passed_over():
    points, _ = polyline.evenly(jnp.asarray(PATH), jnp.array([1.0, 0.0, 1.0]), 5)
    np.testing.assert_allclose(points[1::2], [(0.5, 0.0), (2.5, 2.0)])
    assert np.all(np.isfinite(points))


def test_fractional_waypoint_numbers_divide_the_steps():
    found = polyline.between(jnp.asarray(PATH), jnp.array([0.0, 0.25, 1.5, 3.0]))
    np.testing.assert_allclose(found, [(0, 0), (0.25, 0), (1, 1), (4, 2)])


def test_steps_are_cut_into_the_parts_that_are_given():
    found = polyline.divided(PATH.astype(float), [1, 4, 2])
    np.testing.assert_allclose(
        found, [(0, 0), (1, 0), (1, 0.5), (1, 1), (1, 1.5), (1, 2), (2.5, 2), (4, 2)]
    )
    with pytest.raises(ValueError, match="longer"):
        polyline.divided(PATH.astype(float), [1, 4, 2, 1])
