"""A second kind of distance field, for the tests: distances on a grid, linear in between."""

from dataclasses import dataclass
from itertools import product

import jax
import jax.numpy as jnp
import numpy as np

from drpbench.geometry import signed_distance


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Voxels:
    """`values` (X, Y, Z) [m] at the corners `low` + `spacing` (i, j, k) [m]. Beyond the grid, its
    nearest."""

    values: jax.Array
    low: jax.Array
    spacing: jax.Array

    def distance(self, points):
        return self.distance_and_normal(points)[0]

    def distance_and_normal(self, points):
        size = jnp.array(self.values.shape)
        at = jnp.clip((points - self.low) / self.spacing, 0.0, size - 1.001)
        cell = at.astype(jnp.int32)
        share = at - cell
        distance, gradient = 0.0, 0.0
        for corner in product((0, 1), repeat=3):
            corner = np.array(corner)
            value = self.values[tuple(jnp.moveaxis(cell + corner, -1, 0))]
            weight = jnp.where(corner, share, 1.0 - share)
            # d/dx of a product of three weights: the sign of one times the two others.
            others = jnp.stack(
                [
                    weight[..., 1] * weight[..., 2],
                    weight[..., 0] * weight[..., 2],
                    weight[..., 0] * weight[..., 1],
                ],
                axis=-1,
            )
            distance = distance + jnp.prod(weight, axis=-1) * value
            gradient = gradient + (2 * corner - 1) * others * value[..., None]
        length = jnp.sqrt(jnp.sum(gradient * gradient, axis=-1, keepdims=True))
        return distance, gradient / jnp.maximum(length, 1e-9)


def voxels(primitives, low, high, spacing):
    """The field of some primitives on a grid from `low` to `high` [m]."""
    axes = [np.arange(a, b + spacing, spacing) for a, b in zip(low, high, strict=True)]
    corners = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).astype(np.float32)
    values = jax.jit(signed_distance)(jnp.asarray(corners.reshape(-1, 3)), primitives)
    return Voxels(
        values=values.reshape(corners.shape[:3]),
        low=jnp.asarray(low, jnp.float32),
        spacing=jnp.float32(spacing),
    )
