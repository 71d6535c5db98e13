"""What a chunk of actions means: the one place that training and rollout both read it from.

Row k = 1..10 of a chunk is the joint displacement from the present configuration q to where the arm
shall be k control steps later, in units that make every row of the order of one:

    waypoint_k = q + chunk_k * k * CONTROL_PERIOD * SPEED * VELOCITY_LIMIT * s(q, goal)
    s(q, goal) = clip(max_i |goal_i - q_i| / RAMP, FLOOR, 1)

So a chunk of ones is motion at the demonstrations' speed, and near the goal the same error of the
network moves the arm less: it converges to the goal instead of wandering about it. The paper's chunk
holds delta joint actions too; its units are not published.
"""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from drpbench.contract import CONTROL_PERIOD
from drpbench.robot import PANDA

CHUNK = 10
"""Waypoints of a chunk, one a control step (1/60 s)."""
SPEED = 0.4
"""The share of the velocity limits that demonstrations move at."""
RAMP = 0.25
"""[rad] The arm slows down where the joint farthest from its goal is nearer than this."""
FLOOR = 1e-3
"""The smallest scale: keeps `encode` finite at the goal."""
LOOKAHEAD = 3
"""Which waypoint is commanded, counted from 1. The servos lag their target by kd / kp = 0.05 s
(`Robot.servo_lag`), which is three control steps: a target that far ahead makes the arm keep to the path's
time."""

# [rad] for s = 1: shape (10, 7).
_UNIT = np.arange(1, CHUNK + 1)[:, None] * CONTROL_PERIOD * SPEED * PANDA.velocity_limit


def scale(q: Float[Array, "*batch 7"], goal: Float[Array, "*batch 7"]) -> Float[Array, "*batch"]:
    """s(q, goal): 1 far from the goal, FLOOR at it."""
    return jnp.clip(jnp.max(jnp.abs(goal - q), axis=-1) / RAMP, FLOOR, 1.0)


def _units(q: Float[Array, "*batch 7"], goal: Float[Array, "*batch 7"]):
    return jnp.asarray(_UNIT, q.dtype) * scale(q, goal)[..., None, None]


def encode(
    waypoints: Float[Array, "*batch 10 7"],
    q: Float[Array, "*batch 7"],
    goal: Float[Array, "*batch 7"],
) -> Float[Array, "*batch 10 7"]:
    """The chunk of the next ten waypoints [rad], 1/60 s apart; the inverse of `decode`."""
    return (waypoints - q[..., None, :]) / _units(q, goal)


def decode(
    chunk: Float[Array, "*batch 10 7"],
    q: Float[Array, "*batch 7"],
    goal: Float[Array, "*batch 7"],
) -> Float[Array, "*batch 10 7"]:
    """The ten waypoints [rad] that a chunk means at configuration q [rad]; not clipped to the limits."""
    return q[..., None, :] + chunk * _units(q, goal)


def commanded(
    chunk: Float[Array, "*batch 10 7"],
    q: Float[Array, "*batch 7"],
    goal: Float[Array, "*batch 7"],
) -> Float[Array, "*batch 7"]:
    """The joint position target [rad] of a chunk: its waypoint LOOKAHEAD."""
    return decode(chunk, q, goal)[..., LOOKAHEAD - 1, :]
