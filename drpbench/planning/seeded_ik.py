"""Inverse kinematics on the host from random seeds: what its solvers have in common."""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np

from drpbench.robot import Robot

from .checker import Checker
from .joint_limits import inner_limits


class SeededInverseKinematics(ABC):
    """Joint configurations that put the grip frame into a pose."""

    def __init__(self, robot: Robot):
        self._robot = robot
        self._lower, self._upper = inner_limits(robot)

    def solve(
        self,
        rng: np.random.Generator,
        position: np.ndarray,
        quaternion: np.ndarray,
        checker: Checker,
        clearance: float,
        seeds: int = 4,
    ) -> np.ndarray | None:
        """Configuration (J,) for the grip pose, or None if no seed leads to one.

        `position` (3,) [m], `quaternion` (4,) wxyz. The first solution that keeps `LIMIT_MARGIN`
        from the joint limits and `clearance` [m] from the checker's scene is returned. Seeds are
        random about the home configuration, turned towards the pose.
        """
        robot = self._robot
        bearing = np.arctan2(position[1], position[0])
        for _ in range(seeds):
            seed = robot.home + robot.generation_spread * rng.uniform(-1, 1, robot.joints)
            seed[0] += bearing
            seed[-1] = rng.uniform(-2.5, 2.5)
            q = self._descend(np.clip(seed, self._lower, self._upper), position, quaternion)
            if q is not None and checker.free(q, clearance):
                return q
        return None

    @abstractmethod
    def _descend(
        self, q: np.ndarray, position: np.ndarray, quaternion: np.ndarray
    ) -> np.ndarray | None:
        """Steps from `q` (J,) to a configuration within the limits, or None."""
