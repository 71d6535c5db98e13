"""Which scene points move: those that were not there a frame ago.

The paper builds a KD-tree of the previous frame's cloud and queries it with the current one; here
the nearest neighbour is searched by brute force, for the points near the arm only, because only
they can matter.
"""

from typing import cast

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from drpbench.compile import stored

NEAR_POINTS = 256
_UNSEEN = 1.0e3  # [m] coordinates of a point that is not there
_RINGS = (0.05, 0.1, 0.15, 0.2, 0.25, 0.3, 0.35, 0.4)  # [m]


def near_arm(
    points: Float[Array, "N 3"],
    mask: Bool[Array, " N"],
    centers: Float[Array, "S 3"],
    radii: Float[Array, " S"],
) -> Float[Array, "P 3"]:
    """Up to 256 scene points that are nearest to the arm, given coarsely as spheres.

    Points are taken by rings of distance, outer rings only as far as all of them fit.
    """
    x, y, z = (jnp.where(mask, points[:, i], _UNSEEN) for i in range(3))
    nearest = jnp.full(points.shape[0], _UNSEEN)
    for i in range(centers.shape[0]):
        dx, dy, dz = x - centers[i, 0], y - centers[i, 1], z - centers[i, 2]
        nearest = jnp.minimum(nearest, jnp.sqrt(dx * dx + dy * dy + dz * dz) - radii[i])
    nearest = stored(nearest)
    rings = jnp.asarray(_RINGS, points.dtype)
    count = jnp.sum(nearest[:, None] < rings, axis=0)
    fits = jnp.sum(count <= NEAR_POINTS)
    # The innermost ring is taken even when it overflows; then some of its points are not looked at.
    kept = nearest < rings[jnp.maximum(fits - 1, 0)]
    rank = jnp.cumsum(kept)
    index = jnp.searchsorted(rank, jnp.arange(1, NEAR_POINTS + 1))
    there = jnp.arange(1, NEAR_POINTS + 1) <= rank[-1]
    chosen = points[jnp.minimum(index, points.shape[0] - 1)]
    return jnp.where(there[:, None], chosen, _UNSEEN)


def squared_distances(
    first: Float[Array, "P 3"], second: Float[Array, "N 3"]
) -> Float[Array, "P N"]:
    """Squared distance [m^2] of every pair, by components: exactly zero for a point and itself."""
    return cast(Array, sum(jnp.square(first[:, None, i] - second[None, :, i]) for i in range(3)))


def is_dynamic(
    near: Float[Array, "P 3"],
    previous_points: Float[Array, "N 3"],
    previous_mask: Bool[Array, " N"],
    threshold: float,
) -> Bool[Array, " P"]:
    """Whether a point of `near` has no neighbour within `threshold` [m] in the previous frame.

    Without a previous frame nothing is dynamic.
    """
    before = jnp.where(previous_mask[:, None], previous_points, -_UNSEEN)
    gap = stored(jnp.min(squared_distances(near, before), axis=1))
    return (gap > threshold**2) & (near[:, 0] < _UNSEEN) & previous_mask.any()


def velocity(
    point: Float[Array, "3"],
    previous_points: Float[Array, "N 3"],
    previous_mask: Bool[Array, " N"],
    period: float,
    farthest: float,
) -> Float[Array, "3"]:
    """Velocity [m/s] of a point from its nearest neighbour a `period` [s] ago.

    Zero where that is farther than `farthest` [m]: then something appeared rather than moved.
    """
    before = jnp.where(previous_mask[:, None], previous_points, -_UNSEEN)
    gaps = stored(squared_distances(point[None], before)[0])
    moved = point - before[jnp.argmin(gaps)]
    return jnp.where(jnp.linalg.norm(moved) < farthest, moved / period, 0.0)
