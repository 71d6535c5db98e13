"""Inverse kinematics of the arm on the host, with mink: a differential solver under joint limits.

mink is imported by what needs it: drawing problems asks for it, nothing else does.
"""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np

from drpbench.errors import DrpbenchError
from drpbench.robot import PANDA, Robot

from .checker import Checker
from .joint_limits import LIMIT_MARGIN, inner_limits

_STEPS = 40
_TOLERANCE = 1e-3  # [m] and [rad]


def _mink() -> Any:
    try:
        import mink
    except ImportError as error:
        raise DrpbenchError(
            "drawing problems needs mink, which is not installed: pip install 'drpbench[authoring]'"
        ) from error
    return mink


class InverseKinematics:
    """Joint configurations that put the grip frame into a pose."""

    def __init__(self, robot: Robot = PANDA):
        """Raises DrpbenchError where mink is not installed."""
        self._mink, self._robot = _mink(), robot
        model = mujoco.MjModel.from_xml_path(str(robot.model))
        self._configuration = self._mink.Configuration(model)
        self._task = self._mink.FrameTask("grip", "site", position_cost=1.0, orientation_cost=0.3)
        self._limits = [self._mink.ConfigurationLimit(model, min_distance_from_limits=LIMIT_MARGIN)]

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
        self._task.set_target(self._mink.SE3(np.concatenate([quaternion, position])))
        lower, upper = inner_limits(robot)
        bearing = np.arctan2(position[1], position[0])
        for _ in range(seeds):
            seed = robot.home + robot.generation_spread * rng.uniform(-1, 1, robot.joints)
            seed[0] += bearing
            seed[-1] = rng.uniform(-2.5, 2.5)
            q = self._descend(np.clip(seed, lower, upper))
            if q is None or np.any(q < lower - 1e-9) or np.any(q > upper + 1e-9):
                continue
            if checker.free(q, clearance):
                return q
        return None

    def _descend(self, seed: np.ndarray) -> np.ndarray | None:
        """Newton steps from `seed` (J,), each a quadratic programme within the limits."""
        configuration, task = self._configuration, self._task
        configuration.update(seed)
        for step in range(_STEPS):
            error = task.compute_error(configuration)
            if np.linalg.norm(error[:3]) < _TOLERANCE and np.linalg.norm(error[3:]) < _TOLERANCE:
                return configuration.q.copy()
            if step == 15 and np.linalg.norm(error[:3]) > 0.2:
                return None  # far out of reach: no use in going on
            velocity = self._mink.solve_ik(
                configuration, [task], 1.0, "daqp", damping=1e-4, limits=self._limits
            )
            configuration.integrate_inplace(np.clip(velocity, -0.6, 0.6), 1.0)
        return None
