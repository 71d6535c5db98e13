"""Voxels as a distance field, against distances that are counted out."""

import jax
import jax.numpy as jnp
import numpy as np

from drpbench.geometry import FAR, Field, VoxelField

SHAPE, SIDE, CORNER = (12, 10, 8), 0.1, (-0.6, -0.5, -0.2)
RNG = np.random.default_rng(0)
CENTERS = (np.stack(np.meshgrid(*map(np.arange, SHAPE), indexing="ij"), -1) + 0.5) * SIDE + CORNER
OCCUPIED = RNG.integers(0, SHAPE, (20, 3))
POINTS = jnp.asarray(CENTERS[tuple(OCCUPIED.T)] + RNG.uniform(-0.049, 0.049, (20, 3)), jnp.float32)


def field(points=POINTS, mask=None):
    there = jnp.ones(len(points), bool) if mask is None else mask
    return VoxelField.of_points(points, there, SHAPE, SIDE, CORNER)


def test_it_is_the_distance_between_centres_less_half_a_voxel():
    assert isinstance(field(), Field)
    full = np.zeros(SHAPE, bool)
    full[tuple(OCCUPIED.T)] = True

    def nearest(of):
        return np.linalg.norm(CENTERS[..., None, :] - CENTERS[of], axis=-1).min(-1)

    expected = np.where(full, SIDE / 2 - nearest(~full), nearest(full) - SIDE / 2)
    np.testing.assert_allclose(field().at_centers, expected, atol=1e-5)
    np.testing.assert_allclose(
        field().distance(jnp.asarray(CENTERS, jnp.float32)), expected, atol=1e-4
    )


def test_masked_points_and_those_outside_the_grid_occupy_nothing():
    outside = jnp.array([[0.7, 0.0, 0.0], [0.0, 0.0, -0.3], [0.0, 5.0, 0.0]])
    nothing = field(outside)
    distance, normal = nothing.distance_and_normal(POINTS)
    assert (distance == FAR).all() and np.isfinite(normal).all()
    half = jnp.arange(len(POINTS)) % 2 == 0
    np.testing.assert_array_equal(
        field(POINTS, half).at_centers, field(POINTS[np.asarray(half)]).at_centers
    )
    more = field(jnp.concatenate([POINTS, outside]))
    np.testing.assert_array_equal(more.at_centers, field().at_centers)


def test_the_normal_is_the_interpolated_distances_gradient():
    inner = jnp.asarray(RNG.uniform(CENTERS.min((0, 1, 2)), CENTERS.max((0, 1, 2)), (200, 3)))
    _, normal = field().distance_and_normal(inner)
    slope = np.asarray(jax.vmap(jax.grad(lambda point: field().distance(point)))(inner))
    steep = np.linalg.norm(slope, axis=1)
    clear = steep > 0.05
    assert clear.mean() > 0.9
    np.testing.assert_allclose(
        np.asarray(normal)[clear], slope[clear] / steep[clear, None], atol=1e-3
    )


def test_outside_the_grid_it_grows_by_the_way_there():
    edge = jnp.array([0.55, 0.0, 0.1])
    away = edge + jnp.array([0.4, 0.0, 0.0])
    distance, normal = field().distance_and_normal(jnp.stack([edge, away]))
    np.testing.assert_allclose(distance[1] - distance[0], 0.4, atol=1e-5)
    np.testing.assert_allclose(normal[1], [1.0, 0.0, 0.0], atol=1e-6)
