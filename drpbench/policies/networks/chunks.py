"""What a chunk of actions means: the one place that training and rollout both read it from.

Row k = 1..10 of a chunk is the joint displacement from the present configuration q to where the arm
shall be k control steps later, in units that make every row of the order of one:

    waypoint_k = q + chunk_k * k * control_period * SPEED * velocity_limit * s(q, goal)
    s(q, goal) = clip(max_i |goal_i - q_i| / RAMP, FLOOR, 1)

So a chunk of ones is motion at the demonstrations' speed, and near the goal the same error of the
network moves the arm less: it converges to the goal instead of wandering about it. The paper's
chunk holds delta joint actions too; its units are not published.
"""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from drpbench.contract import EPISODE
from drpbench.robot import PANDA, Robot

CHUNK = 10
"""Waypoints of a chunk, one a control step."""
SPEED = 0.4
"""The share of the velocity limits that demonstrations move at."""
RAMP = 0.25
"""[rad] The arm slows down where the joint farthest from its goal is nearer than this."""
FLOOR = 1e-3
"""The smallest scale: keeps `encode` finite at the goal."""


def lookahead(robot: Robot = PANDA, control_period: float = EPISODE.period) -> int:
    """Which waypoint is commanded, counted from 1.

    The servos lag their target by `robot.servo_lag`, of the Panda 0.05 s, which is three control
    steps of 1/60 s: a target that far ahead makes the arm keep to the path's time.
    """
    return min(max(1, round(robot.servo_lag / control_period)), CHUNK)


def scale(q: Float[Array, "*batch J"], goal: Float[Array, "*batch J"]) -> Float[Array, "*batch"]:
    """s(q, goal): 1 far from the goal, FLOOR at it."""
    return jnp.clip(jnp.max(jnp.abs(goal - q), axis=-1) / RAMP, FLOOR, 1.0)


def _units(
    q: Float[Array, "*batch J"], goal: Float[Array, "*batch J"], robot: Robot, control_period: float
) -> Float[Array, "*batch 10 J"]:
    unit = np.arange(1, CHUNK + 1)[:, None] * control_period * SPEED * robot.velocity_limit
    return jnp.asarray(unit, q.dtype) * scale(q, goal)[..., None, None]


def encode(
    waypoints: Float[Array, "*batch 10 J"],
    q: Float[Array, "*batch J"],
    goal: Float[Array, "*batch J"],
    robot: Robot = PANDA,
    control_period: float = EPISODE.period,
) -> Float[Array, "*batch 10 J"]:
    """The chunk of the next ten waypoints [rad], one a control step; the inverse of `decode`."""
    return (waypoints - q[..., None, :]) / _units(q, goal, robot, control_period)


def decode(
    chunk: Float[Array, "*batch 10 J"],
    q: Float[Array, "*batch J"],
    goal: Float[Array, "*batch J"],
    robot: Robot = PANDA,
    control_period: float = EPISODE.period,
) -> Float[Array, "*batch 10 J"]:
    """The ten waypoints [rad] that a chunk means at configuration q [rad]; not clipped to the
    limits."""
    return q[..., None, :] + chunk * _units(q, goal, robot, control_period)


def commanded(
    chunk: Float[Array, "*batch 10 J"],
    q: Float[Array, "*batch J"],
    goal: Float[Array, "*batch J"],
    robot: Robot = PANDA,
    control_period: float = EPISODE.period,
) -> Float[Array, "*batch J"]:
    """The joint position target [rad] of a chunk: its waypoint `lookahead`."""
    waypoints = decode(chunk, q, goal, robot, control_period)
    return waypoints[..., lookahead(robot, control_period) - 1, :]
