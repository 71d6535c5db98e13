"""Goals that are given as poses: the joint configuration to plan to."""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, PRNGKeyArray

from drpbench.geometry import Field
from drpbench.robot import PANDA, Robot

from . import ik
from .clearance_cost import gaps
from .stopping import touches


def nearest_goal(
    obstacles: Field,
    start: Float[Array, " J"],
    position: Float[Array, "3"],
    quaternion: Float[Array, "4"],
    key: PRNGKeyArray,
    seeds: int = 32,
    robot: Robot = PANDA,
) -> tuple[Float[Array, " J"], Bool[Array, ""]]:
    """The configuration [rad] for a grip pose (`position` [m], `quaternion` wxyz) to plan to from
    `start`.

    Of the solutions of inverse kinematics that are free of collision the nearest to `start` in time
    at full speed; of the others where none is free. The flag is false where there is no solution at
    all; then the configuration is the one that comes nearest to the pose.
    """
    found = ik.solve(position, quaternion, key, seeds, robot)
    contact = jax.vmap(lambda q: touches(gaps(q, obstacles, robot)))(found.q)
    away = jnp.max(jnp.abs(found.q - start) / robot.velocity_limit.astype(np.float32), axis=1)
    left = found.position_error + found.orientation_error
    rank = jnp.where(found.converged, away + 1.0e2 * contact, 1.0e4 * (1.0 + left))
    best = jnp.argmin(rank)
    return found.q[best], found.converged[best]
