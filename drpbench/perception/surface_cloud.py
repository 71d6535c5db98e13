"""The point clouds of the observation: the same surface points throughout an episode."""

from dataclasses import dataclass

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, PRNGKeyArray

from drpbench.contract import SCENE_POINTS, Movers, Problem
from drpbench.geometry import Primitives, sample_surface
from drpbench.robot import LinkPoses, Robot


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Cloud:
    """Persistent scene points: those of the static scene in the world frame [m], and for each
    moving box the tickets that say where on its surface its points are, whatever size it is born
    with."""

    static_points: Float[Array, "*batch N 3"]
    static_mask: Bool[Array, "*batch N"]
    mover_tickets: Float[Array, "*batch M P 3"]


@dataclass(frozen=True)
class SurfaceCloud:
    """The sensor of the benchmark: `points` of all surfaces, seen from everywhere, without
    noise."""

    points: int = SCENE_POINTS
    ground: bool = True
    """Whether there is a table or floor at z = 0: no point below it is seen."""

    def reset(
        self, keys: tuple[PRNGKeyArray, PRNGKeyArray], problem: Problem, movers: int
    ) -> Cloud:
        """The points of an episode: the static scene's are drawn with the first key, tickets with
        the second."""
        on_static, on_each = shares(movers, self.points)
        points, mask = sample_static(keys[0], problem.obstacles, on_static, self.ground)
        tickets = jax.random.uniform(keys[1], (movers, on_each, 3))
        return Cloud(points, mask, tickets)

    def observe(
        self, state: Cloud, problem: Problem, movers: Movers, robot: Robot, poses: LinkPoses
    ) -> tuple[Float[Array, "N 3"], Bool[Array, " N"]]:
        """Points [m] with the moving boxes where they are, and where there is one."""
        return scene_cloud(state, movers, self.ground)


def shares(movers: int, points: int = SCENE_POINTS) -> tuple[int, int]:
    """How many of the points are on the static scene, and on each of `movers` boxes.

    The reference evaluator draws 2048 of a union of 2048 static points and 1000 a box.
    """
    each = round(points * 1000 / (2048 + 1000 * movers)) if movers else 0
    return points - movers * each, each


def sample_static(
    key: PRNGKeyArray, obstacles: Primitives, count: int, ground: bool = True
) -> tuple[Float[Array, "count 3"], Bool[Array, " count"]]:
    """Points uniform over the static surfaces, with a `ground` over those at z >= 0.

    Twice as many are drawn, the first kept.
    """
    points, _ = sample_surface(key, obstacles, 2 * count)
    above = points[:, 2] >= -1e-6 if ground else jnp.ones(2 * count, bool)
    first = jnp.argsort(~above, stable=True)[:count]
    kept = above[first] & obstacles.mask.any()
    return jnp.where(kept[:, None], points[first], 0.0), kept


def on_box(tickets: Float[Array, "P 3"], half_size: Float[Array, "3"]) -> Float[Array, "P 3"]:
    """Points [m] on the surface of a box about the origin, uniform for tickets uniform in [0, 1).

    The first ticket picks the face, by area; the others the place on it.
    """
    a, b, c = half_size[0], half_size[1], half_size[2]
    first, second = b * c, b * c + a * c
    face = tickets[:, 0] * (second + a * b)
    u, v = (2.0 * tickets[:, i] - 1.0 for i in (1, 2))
    on_x, on_y = face < first, (face >= first) & (face < second)
    # The rest of the face ticket says which of the two opposite faces.
    low = jnp.where(on_x, 0.0, jnp.where(on_y, first, second))
    area = jnp.where(on_x, b * c, jnp.where(on_y, a * c, a * b))
    side = jnp.where(face - low < 0.5 * area, -1.0, 1.0)
    x = jnp.where(on_x, side, u)
    y = jnp.where(on_x, u, jnp.where(on_y, side, v))
    z = jnp.where(on_x | on_y, v, side)
    return jnp.stack([a * x, b * y, c * z], axis=-1)


def scene_cloud(
    cloud: Cloud, movers: Movers, ground: bool = True
) -> tuple[Float[Array, "N 3"], Bool[Array, " N"]]:
    """The scene points with the moving boxes where they are; with a `ground`, points below z = 0
    are left out."""
    local = jax.vmap(on_box)(cloud.mover_tickets, movers.half_size)
    r = movers.rotation[:, None]
    x, y, z = local[..., 0], local[..., 1], local[..., 2]
    turned = [r[..., i, 0] * x + r[..., i, 1] * y + r[..., i, 2] * z for i in range(3)]
    moved = jnp.stack(turned, axis=-1) + movers.position[:, None]
    active = movers.active
    above = moved[..., 2] >= 0.0 if ground else jnp.ones(moved.shape[:-1], bool)
    seen = active[:, None] & above
    moved = jnp.where(seen[..., None], moved, 0.0)
    return (
        jnp.concatenate([cloud.static_points, moved.reshape(-1, 3)]),
        jnp.concatenate([cloud.static_mask, seen.reshape(-1)]),
    )
