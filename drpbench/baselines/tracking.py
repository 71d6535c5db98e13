"""Paths that are planned on the host, given their times and tracked."""

from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from drpbench.compile import jit
from drpbench.planning.polyline import evenly_on_host
from drpbench.planning.retiming import retime, step_lengths
from drpbench.robot import Robot

_WAYPOINTS = 256  # of a path, evenly spaced: its corners are cut by a few millimetres at most
_SAMPLES = 512  # of a trajectory


class Tracks:
    """The trajectory of every instance, and how far it is tracked. At first each stays where it
    is."""

    def __init__(self, joints: np.ndarray, speed: float, robot: Robot, control_period: float):
        """From `joints` (B, J) [rad]; `speed` is the share of the pace that the arm's limits
        allow."""
        self._speed, self._robot, self._period = speed, robot, control_period
        self._clock = np.zeros(len(joints), int)
        self._duration = np.full(len(joints), 1.0)
        self._q = np.repeat(joints[:, None], _SAMPLES, axis=1)

    def follow(self, instance: int, path: np.ndarray) -> None:
        """The instance follows the polyline `path` (k, J) [rad] from now on, within the arm's
        limits."""
        even = jnp.asarray(evenly(path, _WAYPOINTS, self._robot), jnp.float32)
        timed = jax.device_get(_timed(even, self._robot))
        self._q[instance] = timed.q
        self._duration[instance] = max(float(timed.duration), 1e-3)
        self._clock[instance] = 0

    def targets(self) -> np.ndarray:
        """The servos' targets (B, J) [rad] of this control step; the next call has the next
        step's."""
        ahead = self._speed * (self._clock * self._period + self._robot.servo_lag)
        place = np.clip(ahead / self._duration, 0.0, 1.0) * (_SAMPLES - 1)
        low = np.minimum(place.astype(int), _SAMPLES - 2)
        lane, share = np.arange(len(place)), (place - low)[:, None]
        self._clock += 1
        return (1 - share) * self._q[lane, low] + share * self._q[lane, low + 1]


@partial(jit, static_argnums=1)
def _timed(path: jax.Array, robot: Robot) -> Any:
    return retime(path, _SAMPLES, robot)


def evenly(path: np.ndarray, count: int, robot: Robot) -> np.ndarray:
    """The polyline (k, J) at `count` points of even steps of `step_lengths`."""
    steps = np.asarray(step_lengths(jnp.asarray(path, jnp.float32), robot), float)
    return evenly_on_host(path, steps, count)
