"""Inverse kinematics of the arm on the host, with mink: a differential solver under joint limits."""

from __future__ import annotations

import mink
import mujoco
import numpy as np

from drpbench.robot import PANDA

from .checker import Checker

LIMIT_MARGIN = 0.05  # [rad] that a solution keeps from its joint limits
_STEPS = 40
_TOLERANCE = 1e-3  # [m] and [rad]


class InverseKinematics:
    """Joint configurations that put the grip frame into a pose."""

    def __init__(self):
        model = mujoco.MjModel.from_xml_path(str(PANDA.model))
        self._configuration = mink.Configuration(model)
        self._task = mink.FrameTask("grip", "site", position_cost=1.0, orientation_cost=0.3)
        self._limits = [mink.ConfigurationLimit(model, min_distance_from_limits=LIMIT_MARGIN)]

    def solve(
        self,
        rng: np.random.Generator,
        position: np.ndarray,
        quaternion: np.ndarray,
        checker: Checker,
        clearance: float,
        seeds: int = 4,
    ) -> np.ndarray | None:
        """Configuration (7,) for the grip pose, or None if no seed leads to one.

        `position` (3,) [m], `quaternion` (4,) wxyz. The first solution that keeps `LIMIT_MARGIN`
        from the joint limits and `clearance` [m] from the checker's scene is returned. Seeds are
        random about the home configuration, turned towards the pose.
        """
        self._task.set_target(mink.SE3(np.concatenate([quaternion, position])))
        lower, upper = PANDA.joint_lower + LIMIT_MARGIN, PANDA.joint_upper - LIMIT_MARGIN
        bearing = np.arctan2(position[1], position[0])
        for _ in range(seeds):
            seed = PANDA.home + PANDA.generation_spread * rng.uniform(-1, 1, 7)
            seed[0] += bearing
            seed[6] = rng.uniform(-2.5, 2.5)
            q = self._descend(np.clip(seed, lower, upper))
            if q is None or np.any(q < lower - 1e-9) or np.any(q > upper + 1e-9):
                continue
            if checker.free(q, clearance):
                return q
        return None

    def _descend(self, seed: np.ndarray) -> np.ndarray | None:
        """Newton steps from `seed` (7,), each a quadratic programme within the limits."""
        configuration, task = self._configuration, self._task
        configuration.update(seed)
        for step in range(_STEPS):
            error = task.compute_error(configuration)
            if np.linalg.norm(error[:3]) < _TOLERANCE and np.linalg.norm(error[3:]) < _TOLERANCE:
                return configuration.q.copy()
            if step == 15 and np.linalg.norm(error[:3]) > 0.2:
                return None  # far out of reach: no use in going on
            velocity = mink.solve_ik(
                configuration, [task], 1.0, "daqp", damping=1e-4, limits=self._limits
            )
            configuration.integrate_inplace(np.clip(velocity, -0.6, 0.6), 1.0)
        return None
