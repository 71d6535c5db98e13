"""The host's inverse kinematics puts the grip where it is asked for, within the joint limits."""

import numpy as np
import pytest

from drpbench.geometry import Obstacles
from drpbench.geometry import host_rotation as rotation
from drpbench.planning.checker import sphere_checker
from drpbench.planning.host_ik import HostInverseKinematics
from drpbench.planning.joint_limits import inner_limits


@pytest.fixture(scope="module")
def checker():
    checker = sphere_checker()
    far = Obstacles.boxes(
        np.full((1, 3), 0.1), np.array([[0.0, 0.0, -5.0]]), np.array([[1.0, 0, 0, 0]])
    )
    checker.set_obstacles(far)
    return checker


def test_it_finds_the_poses_of_configurations(checker):
    rng, ik = np.random.default_rng(0), HostInverseKinematics()
    lower, upper = inner_limits(checker.robot)
    found = 0
    for _ in range(30):
        wanted = checker.robot.home + rng.uniform(-0.4, 0.4, 7)
        position, matrix = checker.grip_pose(np.clip(wanted, lower, upper))
        q = ik.solve(rng, position, rotation.from_matrix(matrix), checker, 0.0, seeds=8)
        if q is None:
            continue
        found += 1
        here, turned = checker.grip_pose(q)
        assert np.linalg.norm(here - position) < 2e-3
        assert np.arccos(np.clip((np.trace(turned.T @ matrix) - 1) / 2, -1, 1)) < 2e-3
        assert (q >= lower - 1e-9).all() and (q <= upper + 1e-9).all()
    assert found >= 27


def test_a_pose_out_of_reach_has_no_solution(checker):
    ik = HostInverseKinematics()
    pose = np.array([2.0, 0.0, 0.5]), np.array([1.0, 0.0, 0.0, 0.0])
    assert ik.solve(np.random.default_rng(0), *pose, checker, 0.0) is None
