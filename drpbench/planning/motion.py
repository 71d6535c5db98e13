"""How far the arm moves at most between two configurations, and samples that are close by that
measure.

Joint i turning by d moves no point of the arm farther than lever_i |d| (`Robot.lever`).
"""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from drpbench.robot import PANDA, Robot

from . import polyline


def bound(a: np.ndarray, b: np.ndarray, robot: Robot = PANDA) -> float:
    """Metres that no point of the arm exceeds on the joint-space line from `a` (J,) to `b` (J,)."""
    return float(robot.lever @ np.abs(b - a))


def samples(waypoints: np.ndarray, resolution: float, robot: Robot = PANDA) -> np.ndarray:
    """Samples (m, J) along the polyline `waypoints` (k, J), each waypoint among them.

    No point of the arm moves over `resolution` [m] from one to the next.
    """
    bounds = [bound(a, b, robot) for a, b in zip(waypoints[:-1], waypoints[1:], strict=True)]
    return polyline.divided(waypoints, [max(1, int(np.ceil(b / resolution))) for b in bounds])


def even_samples(
    path: Float[Array, "T J"], count: int, robot: Robot = PANDA
) -> tuple[Float[Array, "{count} J"], Float[Array, ""]]:
    """`count` samples of a polyline and the motion [m] that no point of the arm exceeds between
    two."""
    steps = jnp.sum(jnp.abs(jnp.diff(path, axis=0)) * robot.lever.astype(np.float32), axis=1)
    points, whole = polyline.evenly(path, steps, count)
    return points, whole / (count - 1)
