"""Inverse kinematics on the host."""

import sys

import numpy as np
import pytest

from drpbench.errors import DrpbenchError
from drpbench.geometry import host_rotation as rotation
from drpbench.planning.joint_limits import inner_limits
from drpbench.planning.mink_ik import InverseKinematics
from drpbench.robot import PANDA


@pytest.fixture(scope="module")
def solver():
    return InverseKinematics()


def test_solutions_reach_the_pose_within_limits_and_clear(solver, spheres, obstacles):
    spheres.set_obstacles(obstacles())
    rng, solved = np.random.default_rng(0), 0
    for _ in range(30):
        position, matrix = spheres.grip_pose(PANDA.home + rng.normal(0, 0.2, 7))
        quaternion = rotation.from_matrix(matrix)
        q = solver.solve(rng, position, quaternion, spheres, 0.02, seeds=6)
        if q is None:
            continue
        solved += 1
        there, turned = spheres.grip_pose(q)
        assert np.linalg.norm(there - position) < 1.5e-3
        assert np.arccos(np.clip((np.trace(matrix.T @ turned) - 1) / 2, -1, 1)) < 3e-3
        lower, upper = inner_limits(PANDA)
        assert np.all(q > lower - 1e-6) and np.all(q < upper + 1e-6)
        assert spheres.clearance(q) > 0.02
    assert solved >= 27


def test_a_pose_out_of_reach_or_in_an_obstacle_has_none(solver, spheres, obstacles):
    spheres.set_obstacles(obstacles())
    rng, (position, matrix) = np.random.default_rng(0), spheres.grip_pose(PANDA.home)
    quaternion = rotation.from_matrix(matrix)
    assert solver.solve(rng, position + (1.0, 0, 0), quaternion, spheres, 0.0) is None
    spheres.set_obstacles(obstacles((2, (0.05,) * 3, position)))
    assert solver.solve(rng, position, quaternion, spheres, 0.0) is None


def test_without_mink_the_message_names_the_extra(monkeypatch):
    monkeypatch.setitem(sys.modules, "mink", None)
    with pytest.raises(DrpbenchError, match=r"pip install 'drpbench\[authoring\]'"):
        InverseKinematics()
