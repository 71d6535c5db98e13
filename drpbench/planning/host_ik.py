"""Inverse kinematics of the arm on the host, fast: for drawing problems by the hundred thousand.

Damped least squares with Levenberg and Marquardt's rule, as in `ik.py`, one pose at a time on
MuJoCo's kinematics: a step is a solve of six equations, where mink's is a quadratic programme.
"""

from __future__ import annotations

import mujoco
import numpy as np

from drpbench.robot import PANDA, Robot

from .seeded_ik import SeededInverseKinematics

_STEPS = 40
_TOLERANCE = 1e-3  # [m] and [rad]
_LARGEST = 0.6  # [rad] that a joint moves at most in a step


class HostInverseKinematics(SeededInverseKinematics):
    """Joint configurations that put the grip frame into a pose."""

    def __init__(self, robot: Robot = PANDA):
        super().__init__(robot)
        self._model = mujoco.MjModel.from_xml_path(str(robot.model))
        self._data = mujoco.MjData(self._model)
        self._grip = self._model.site("grip").id
        self._jacobian = np.zeros((6, self._model.nv))

    def _error(self, q: np.ndarray, position: np.ndarray, quaternion: np.ndarray) -> np.ndarray:
        """(6,): [m] and rotation vector [rad] from the grip to the pose, in the world's frame."""
        model, data = self._model, self._data
        data.qpos[: self._robot.joints] = q
        mujoco.mj_kinematics(model, data)
        error, here, turned, back = np.empty(6), np.empty(4), np.empty(4), np.empty(4)
        error[:3] = position - data.site_xpos[self._grip]
        mujoco.mju_mat2Quat(here, data.site_xmat[self._grip])
        mujoco.mju_negQuat(back, here)
        mujoco.mju_mulQuat(turned, quaternion, back)
        mujoco.mju_quat2Vel(error[3:], turned, 1.0)
        return error

    def _descend(
        self, q: np.ndarray, position: np.ndarray, quaternion: np.ndarray
    ) -> np.ndarray | None:
        """Steps from `q` (J,) until both errors are within the tolerance."""
        model, data, jacobian = self._model, self._data, self._jacobian
        quaternion = quaternion / np.linalg.norm(quaternion)
        error, damping = self._error(q, position, quaternion), 1e-2
        for step in range(_STEPS):
            if np.linalg.norm(error[:3]) < _TOLERANCE and np.linalg.norm(error[3:]) < _TOLERANCE:
                return q
            if step == 15 and np.linalg.norm(error[:3]) > 0.2:
                return None  # far out of reach: no use in going on
            data.qpos[: self._robot.joints] = q
            mujoco.mj_kinematics(model, data)
            mujoco.mj_comPos(model, data)
            mujoco.mj_jacSite(model, data, jacobian[:3], jacobian[3:], self._grip)
            own = jacobian[:, : self._robot.joints]
            move = self._move(own, error, damping)
            held = ((q <= self._lower) & (move < 0)) | ((q >= self._upper) & (move > 0))
            if held.any():
                move = self._move(np.where(held, 0.0, own), error, damping)
            tried = np.clip(q + np.clip(move, -_LARGEST, _LARGEST), self._lower, self._upper)
            found = self._error(tried, position, quaternion)
            if found @ found < error @ error:
                q, error, damping = tried, found, max(0.3 * damping, 1e-6)
            else:
                damping = min(5.0 * damping, 10.0)
        return None

    @staticmethod
    def _move(jacobian: np.ndarray, error: np.ndarray, damping: float) -> np.ndarray:
        return jacobian.T @ np.linalg.solve(jacobian @ jacobian.T + damping * np.eye(6), error)
