"""Where to stop when the goal is obstructed: as near to it as the arm gets without touching."""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from drpbench.geometry import FAR, Field
from drpbench.robot import PANDA, Robot

from . import polyline
from .clearance_cost import Gaps, clearance_cost, everywhere, gaps
from .levenberg_marquardt import minimise
from .path_check import CLEARANCE

STOP_CLEARANCE = 0.03  # [m] kept from obstacles, and from the arm itself, where the path ends
_WEIGHT = 1.0e4  # [rad^2/m^2] of clearance: a pull of 2 rad costs it a millimetre or less
_ITERATIONS = 80
_STEP = 0.05  # [rad] that a joint moves at most in one: nothing is jumped over


def touches(found: Gaps) -> Bool[Array, ""]:
    """Whether a configuration with these gaps is out of bounds for a path."""
    nearest_own = jnp.min(found.own, initial=FAR)  # an arm may have none
    return (jnp.min(found.obstacle) < CLEARANCE) | (nearest_own <= 0.0)


def up_to_contact(
    path: Float[Array, "T J"], obstacles: Field, robot: Robot = PANDA
) -> Float[Array, "T J"]:
    """The stretch of a path before its first contact, at as many waypoints, each step divided
    evenly."""
    count = len(path)
    contact = jax.vmap(lambda q: touches(gaps(q, obstacles, robot)))(path)
    last = jnp.min(jnp.where(contact, jnp.arange(count) - 1, count - 1))
    return polyline.between(path, jnp.linspace(0.0, 1.0, count) * jnp.maximum(last, 0))


def nearest_stop(
    q: Float[Array, " J"],
    goal: Float[Array, " J"],
    obstacles: Field,
    lower: Float[Array, " J"],
    upper: Float[Array, " J"],
    robot: Robot = PANDA,
) -> Float[Array, " J"]:
    """Slides `q` [rad] as near to `goal` as STOP_CLEARANCE allows, within the joint limits given.

    Minimises |q - goal|^2 / 2 + _WEIGHT clearance_cost by Levenberg and Marquardt's method.
    """
    wanted = everywhere(STOP_CLEARANCE, robot)

    def evaluate(q):
        cost, gradient, hessian = clearance_cost(q, obstacles, wanted, robot)
        offset = q - goal
        return (
            0.5 * jnp.sum(offset * offset) + _WEIGHT * cost,
            offset + _WEIGHT * gradient,
            jnp.eye(robot.joints) + _WEIGHT * hessian,
        )

    def propose(q, gradient, hessian, damping):
        factor = jax.scipy.linalg.cho_factor(hessian + damping * jnp.eye(robot.joints))
        move = -jax.scipy.linalg.cho_solve(factor, gradient)
        return jnp.clip(q + jnp.clip(move, -_STEP, _STEP), lower, upper)

    return minimise(evaluate, propose, q, _ITERATIONS)


def shortened(
    path: Float[Array, "T J"],
    goal: Float[Array, " J"],
    obstacles: Field,
    lower: Float[Array, " J"],
    upper: Float[Array, " J"],
    robot: Robot = PANDA,
) -> Float[Array, "T J"]:
    """`path` cut off before its first contact, its end moved on to the nearest stop before `goal`.

    What the end moves by is spread over the last waypoints, so that the start stays.
    """
    free = up_to_contact(path, obstacles, robot)
    offset = nearest_stop(free[-1], goal, obstacles, lower, upper, robot) - free[-1]
    share = np.clip(np.linspace(-2.0, 1.0, len(path)), 0.0, 1.0)[:, None]
    return free + share * offset
