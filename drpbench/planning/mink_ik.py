"""Inverse kinematics of the arm on the host, with mink: a differential solver under joint limits.

mink is imported by what needs it: drawing problems asks for it, nothing else does.
"""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np

from drpbench.errors import DrpbenchError
from drpbench.robot import PANDA, Robot

from .joint_limits import LIMIT_MARGIN
from .seeded_ik import SeededInverseKinematics

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


class InverseKinematics(SeededInverseKinematics):
    """Joint configurations that put the grip frame into a pose."""

    def __init__(self, robot: Robot = PANDA):
        """Raises DrpbenchError where mink is not installed."""
        super().__init__(robot)
        self._mink = _mink()
        model = mujoco.MjModel.from_xml_path(str(robot.model))
        self._configuration = self._mink.Configuration(model)
        self._task = self._mink.FrameTask("grip", "site", position_cost=1.0, orientation_cost=0.3)
        self._limits = [self._mink.ConfigurationLimit(model, min_distance_from_limits=LIMIT_MARGIN)]

    def _descend(
        self, q: np.ndarray, position: np.ndarray, quaternion: np.ndarray
    ) -> np.ndarray | None:
        """Newton steps from `q` (J,), each a quadratic programme within the limits."""
        configuration, task = self._configuration, self._task
        task.set_target(self._mink.SE3(np.concatenate([quaternion, position])))
        configuration.update(q)
        for step in range(_STEPS):
            error = task.compute_error(configuration)
            if np.linalg.norm(error[:3]) < _TOLERANCE and np.linalg.norm(error[3:]) < _TOLERANCE:
                found = configuration.q.copy()
                within = (found >= self._lower - 1e-9) & (found <= self._upper + 1e-9)
                return found if within.all() else None
            if step == 15 and np.linalg.norm(error[:3]) > 0.2:
                return None  # far out of reach: no use in going on
            velocity = self._mink.solve_ik(
                configuration, [task], 1.0, "daqp", damping=1e-4, limits=self._limits
            )
            configuration.integrate_inplace(np.clip(velocity, -0.6, 0.6), 1.0)
        return None
