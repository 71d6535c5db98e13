"""The point clouds of the observation: the same surface points throughout an episode."""

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, PRNGKeyArray

from drpbench.geometry import Primitives, sample_surface
from drpbench.robot import BodyPoints, surface_points

from .observation import ROBOT_POINTS, SCENE_POINTS


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Cloud:
    """Persistent scene points: those of the static scene in the world frame [m], those of each moving
    box as offsets from its centre, turned into the world frame (boxes do not turn)."""

    static_points: Float[Array, "N 3"]
    static_mask: Bool[Array, " N"]
    mover_offsets: Float[Array, "M P 3"]


def shares(movers: int) -> tuple[int, int]:
    """How many of the 2048 points are on the static scene, and on each of `movers` boxes.

    The reference evaluator draws 2048 of a union of 2048 static points and 1000 a box.
    """
    each = round(SCENE_POINTS * 1000 / (2048 + 1000 * movers)) if movers else 0
    return SCENE_POINTS - movers * each, each


def sample_static(
    key: PRNGKeyArray, obstacles: Primitives, count: int
) -> tuple[Float[Array, "count 3"], Bool[Array, " count"]]:
    """Points uniform over the static surfaces at z >= 0: twice as many are drawn, the first kept."""
    points, _ = sample_surface(key, obstacles, 2 * count)
    above = points[:, 2] >= -1e-6
    first = jnp.argsort(~above, stable=True)[:count]
    kept = above[first] & obstacles.mask.any()
    return jnp.where(kept[:, None], points[first], 0.0), kept


def sample_box(
    key: PRNGKeyArray, half_size: Float[Array, "3"], rotation: Float[Array, "3 3"], count: int
) -> Float[Array, "count 3"]:
    """Offsets [m] from a box's centre to points uniform over its surface, in the world frame."""
    box = Primitives(
        kind=jnp.zeros(1, jnp.int32),
        half_size=half_size[None],
        position=jnp.zeros((1, 3)),
        rotation=rotation[None],
        mask=jnp.ones(1, bool),
    )
    return sample_surface(key, box, count)[0]


def scene_cloud(
    cloud: Cloud, position: Float[Array, "M 3"], active: Bool[Array, " M"]
) -> tuple[Float[Array, "2048 3"], Bool[Array, "2048"]]:
    """The scene points with the moving boxes where they are; points below z = 0 are left out."""
    moved = cloud.mover_offsets + position[:, None, :]
    seen = active[:, None] & (moved[..., 2] >= 0.0)
    moved = jnp.where(seen[..., None], moved, 0.0)
    return (
        jnp.concatenate([cloud.static_points, moved.reshape(-1, 3)]),
        jnp.concatenate([cloud.static_mask, seen.reshape(-1)]),
    )


def robot_points() -> BodyPoints:
    """The arm's surface points of the observation."""
    points = surface_points()
    return points.part(np.linspace(0, points.count - 1, ROBOT_POINTS).round().astype(int))
