"""The verdict on a finished path, at fine resolution."""

from dataclasses import dataclass

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from drpbench.geometry import Field
from drpbench.robot import PANDA, Robot

from .motion import even_samples

CLEARANCE = 0.0055  # [m] at every sample: the certificate asks for 5 mm at samples of its own
SAMPLES = 1024  # of a path, equally spaced in motion


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class PathCheck:
    """`free`: the whole path may be used. `clearance` [m]: its smallest, of obstacles alone."""

    free: Bool[Array, "*batch"]
    clearance: Float[Array, "*batch"]


def check_path(path: Float[Array, "T J"], obstacles: Field, robot: Robot = PANDA) -> PathCheck:
    """Checks the polyline `path` [rad] against the obstacles, the arm itself and the joint limits.

    At every sample every moving sphere must keep CLEARANCE, and half of the motion between samples
    where that is more: so the spheres touch nothing between the samples either. Links of the arm
    may come as near each other as they like without touching. NaN never passes.
    """
    model = robot.moving_spheres
    points, spacing = even_samples(path, SAMPLES, robot)

    def clearances(q):
        poses = robot.link_poses(q)
        gaps = obstacles.distance(model.world(poses)) - model.radius
        return jnp.min(gaps), robot.self_clearance(poses)

    obstacle, own = jax.vmap(clearances)(points)
    needed = jnp.maximum(CLEARANCE, 0.5 * spacing)
    within = jnp.all((points >= robot.joint_lower) & (points <= robot.joint_upper), axis=1)
    good = (obstacle >= needed) & (own > 0.0) & within
    return PathCheck(jnp.all(good), jnp.min(obstacle))
