"""The verdict on a finished path, at fine resolution."""

from dataclasses import dataclass

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from drpbench.geometry import Primitives, signed_distance
from drpbench.robot import PANDA

from .retiming import along

CLEARANCE = 0.0055  # [m] at every sample: the certificate asks for 5 mm at samples of its own
SAMPLES = 1024  # of a path, equally spaced in motion


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class PathCheck:
    """`free`: the whole path may be used. `clearance` [m]: its smallest, of obstacles alone."""

    free: Bool[Array, "*batch"]
    clearance: Float[Array, "*batch"]


def motion_samples(
    path: Float[Array, "T 7"], count: int
) -> tuple[Float[Array, "{count} 7"], Float[Array, ""]]:
    """`count` samples of a polyline and the motion [m] that no point of the arm exceeds between two.

    Joint i turning by d moves no point farther than lever[i] |d| (`Robot.lever`).
    """
    steps = jnp.sum(jnp.abs(jnp.diff(path, axis=0)) * PANDA.lever.astype("float32"), axis=1)
    ends = jnp.concatenate([jnp.zeros(1), jnp.cumsum(steps)])
    wanted = jnp.linspace(0.0, 1.0, count) * ends[-1]
    return along(path, ends, wanted), ends[-1] / (count - 1)


def check_path(path: Float[Array, "T 7"], obstacles: Primitives) -> PathCheck:
    """Checks the polyline `path` [rad] against obstacles (K,), the arm itself and the joint limits.

    At every sample every moving sphere must keep CLEARANCE, and half of the motion between samples
    where that is more: so the spheres touch nothing between the samples either. Links of the arm may
    come as near each other as they like without touching. NaN never passes.
    """
    model = PANDA.moving_spheres
    points, spacing = motion_samples(path, SAMPLES)

    def rooms(q):
        poses = PANDA.link_poses(q)
        gaps = signed_distance(model.world(poses), obstacles) - model.radius
        return jnp.min(gaps), PANDA.self_clearance(poses)

    obstacle, own = jax.vmap(rooms)(points)
    needed = jnp.maximum(CLEARANCE, 0.5 * spacing)
    within = jnp.all((points >= PANDA.joint_lower) & (points <= PANDA.joint_upper), axis=1)
    good = (obstacle >= needed) & (own > 0.0) & within
    return PathCheck(jnp.all(good), jnp.min(obstacle))
