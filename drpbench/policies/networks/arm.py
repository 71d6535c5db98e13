"""What a network is told of the arm: its joints, the way to its goal, and points on it."""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from drpbench.contract import ROBOT_POINTS
from drpbench.robot import PANDA, BodyPoints, Robot

from .chunks import FLOOR, RAMP


def normalised(q: Float[Array, "*batch J"], robot: Robot = PANDA) -> Float[Array, "*batch J"]:
    """Joints [rad] as shares of their range, [-1, 1]."""
    middle = 0.5 * (robot.joint_upper + robot.joint_lower)
    half = 0.5 * (robot.joint_upper - robot.joint_lower)
    return (q - jnp.asarray(middle, q.dtype)) / jnp.asarray(half, q.dtype)


def joint_inputs(
    joints: Float[Array, "*batch J"], goal: Float[Array, "*batch J"], robot: Robot = PANDA
) -> tuple[Float[Array, "*batch J"], Float[Array, "*batch J"], Float[Array, "*batch 2*J"]]:
    """The joints and the goal as shares of their range, and the way from one to the other: as such
    a difference, and as a direction, because a chunk's units shrink at the goal (`chunks.py`)."""
    q, g = normalised(joints, robot), normalised(goal, robot)
    away = goal - joints
    farthest = jnp.max(jnp.abs(away), axis=-1, keepdims=True)
    towards = away / jnp.maximum(farthest, FLOOR * RAMP)
    return q, g, jnp.concatenate([g - q, towards], axis=-1)


def arm_at(
    q: Float[Array, "*batch J"], count: int, robot: Robot = PANDA
) -> Float[Array, "*batch {count} 3"]:
    """Every (256 / count)-th of the observed points of the arm, at joints `q` [rad]: positions
    [m]."""
    observed = robot.surface_points(ROBOT_POINTS)
    return world(observed.part(np.arange(0, ROBOT_POINTS, ROBOT_POINTS // count)), q, robot)


def world(
    points: BodyPoints, q: Float[Array, "*batch J"], robot: Robot
) -> Float[Array, "*batch S 3"]:
    """Where points of the arm are [m] at joints `q` [rad]."""
    flat = jax.vmap(lambda one: points.world(robot.link_poses(one)))(q.reshape(-1, robot.joints))
    return flat.reshape(*q.shape[:-1], points.count, 3)
