"""A distance field on a grid: what occupied voxels are a distance from, and in which direction.

The distance between voxel centres is exact (Felzenszwalb and Huttenlocher, 2012, by their
separable form): along one axis after another,

    g(i) = min_j f(j) + (i - j)^2,    f = 0 at occupied voxels, infinite elsewhere

so that sqrt(g) is the Euclidean distance in voxels after the third. Half a voxel less is that to
the voxels' surfaces. The same of the free ones is the depth inside. Between centres it is
interpolated.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from .distance import FAR


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class VoxelField:
    """Signed distance [m] at the centres of voxels, and in between; a `Field`.

    A point outside the grid is as far away as the nearest place in it, and the way there more.
    """

    at_centers: Float[Array, "X Y Z"]
    """[m] Negative in occupied voxels; FAR where nothing is occupied."""
    side: float = field(metadata={"static": True})
    """[m] of a voxel."""
    corner: tuple[float, float, float] = field(metadata={"static": True})
    """[m] The grid's least x, y and z in the world frame."""

    @classmethod
    def of_points(
        cls,
        points: Float[Array, "N 3"],
        mask: Bool[Array, " N"],
        shape: tuple[int, int, int],
        side: float,
        corner: tuple[float, float, float],
    ) -> VoxelField:
        """The field of those voxels in which there is a point [m]; points outside the grid are
        left out."""
        place = jnp.floor((points - jnp.array(corner)) / side).astype(jnp.int32)
        inside = mask & jnp.all((place >= 0) & (place < jnp.array(shape)), axis=-1)
        # Those left out fall off the array's end.
        index = jnp.where(inside, jnp.ravel_multi_index(tuple(place.T), shape, mode="clip"), -1)
        count = int(np.prod(shape))
        occupied = jnp.zeros(count, bool).at[jnp.where(inside, index, count)].set(True, mode="drop")
        return cls(signed_distance_of(occupied.reshape(shape), side), side, corner)

    def distance(self, points: Float[Array, "*points 3"]) -> Float[Array, "*points"]:
        """Signed distance [m] from each point."""
        return self.distance_and_normal(points)[0]

    def distance_and_normal(
        self, points: Float[Array, "*points 3"]
    ) -> tuple[Float[Array, "*points"], Float[Array, "*points 3"]]:
        """`distance`, and the direction in which the interpolated distance grows fastest."""
        shape = np.array(self.at_centers.shape)
        place = (points - jnp.array(self.corner)) / self.side - 0.5  # in voxels
        within = jnp.clip(place, 0.0, jnp.array(shape - 1, place.dtype))
        low = jnp.minimum(within.astype(jnp.int32), jnp.array(shape - 2))
        share = within - low
        strides = jnp.array([shape[1] * shape[2], shape[2], 1])
        flat = self.at_centers.reshape(-1)
        first = jnp.sum(low * strides, axis=-1)
        x, y, z = (share[..., axis] for axis in range(3))

        def corner(i: int, j: int, k: int) -> Array:
            return flat[first + i * strides[0] + j * strides[1] + k]

        # Along z, then y, then x; the slopes are of the same sums.
        edges = [[(corner(i, j, 0), corner(i, j, 1)) for j in (0, 1)] for i in (0, 1)]
        along_z = [[a + z * (b - a) for a, b in side] for side in edges]
        along_y = [a + y * (b - a) for a, b in along_z]
        value = along_y[0] + x * (along_y[1] - along_y[0])
        steps_z = [[b - a for a, b in side] for side in edges]
        slope_z = [a + y * (b - a) for a, b in steps_z]
        slope_y = [b - a for a, b in along_z]
        slope = jnp.stack(
            [
                along_y[1] - along_y[0],
                slope_y[0] + x * (slope_y[1] - slope_y[0]),
                slope_z[0] + x * (slope_z[1] - slope_z[0]),
            ],
            axis=-1,
        )
        beyond = self.side * (place - within)
        squared = jnp.sum(jnp.square(beyond), axis=-1)
        outside = squared > 0.0  # a root has no slope at zero
        away = jnp.where(outside, jnp.sqrt(jnp.where(outside, squared, 1.0)), 0.0)
        steep = jnp.sqrt(jnp.sum(jnp.square(slope), axis=-1, keepdims=True))
        up = jnp.array([0.0, 0.0, 1.0], slope.dtype)
        normal = jnp.where(steep > 1e-9, slope / jnp.maximum(steep, 1e-9), up)
        # Outside the grid it is farther from everything in it the farther it is from the grid.
        outwards = beyond / jnp.maximum(away, 1e-9)[..., None]
        normal = jnp.where(outside[..., None], outwards, normal)
        return jnp.minimum(value + away, FAR), normal


def signed_distance_of(occupied: Bool[Array, "X Y Z"], side: float) -> Float[Array, "X Y Z"]:
    """[m] from each voxel's centre to the surfaces of the occupied ones; negative in them."""
    outside, inside = _in_voxels(occupied), _in_voxels(~occupied)
    signed = jnp.where(occupied, 0.5 - inside, outside - 0.5)
    return jnp.where(occupied.any(), side * signed, FAR)


def _in_voxels(occupied: Bool[Array, "X Y Z"]) -> Float[Array, "X Y Z"]:
    """Distance between centres, in voxels, to the nearest occupied one."""
    squared = jnp.where(occupied, 0.0, 1e9)
    for axis in range(3):
        squared = jnp.moveaxis(squared, axis, 0)
        number = jnp.arange(squared.shape[0])

        def from_row(least: Array, row: tuple[Array, Array], number: Array = number) -> tuple:
            j, f = row
            gap = jnp.square(number - j).astype(f.dtype)
            return jnp.minimum(least, f + gap[:, None, None]), None

        least, _ = jax.lax.scan(from_row, jnp.full_like(squared, 1e9), (number, squared))
        squared = jnp.moveaxis(least, 0, axis)
    return jnp.sqrt(squared)
