"""Joints for a goal that is given as a pose of the hand."""

from __future__ import annotations

import numpy as np

from drpbench.geometry import Obstacles
from drpbench.planning.checker import sphere_checker
from drpbench.planning.host_ik import HostInverseKinematics
from drpbench.robot import Robot

_TRIES = 24  # solutions that are looked for, from random postures


class GoalJoints:
    """Finds them for one arm. Holds a compiled checker, so make one and keep it."""

    def __init__(self, robot: Robot):
        self._spheres, self._ik = sphere_checker(robot=robot), HostInverseKinematics(robot)

    def nearest(
        self, start: np.ndarray, position: np.ndarray, quaternion: np.ndarray, obstacles: Obstacles
    ) -> np.ndarray | None:
        """Of several solutions (J,) that are free, the one nearest to `start`; None where none is.

        The same every time: the search's random numbers are its own.
        """
        self._spheres.set_obstacles(obstacles)
        rng, found = np.random.default_rng(0), []
        for _ in range(_TRIES):
            q = self._ik.solve(rng, position.astype(float), quaternion, self._spheres, 0.0)
            if q is not None and self._spheres.free(q.astype(np.float32).astype(float)):
                found.append(q.astype(np.float32))
        return min(found, key=lambda q: float(np.abs(q - start).max()), default=None)
