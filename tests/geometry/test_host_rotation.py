"""Rotations on the host agree with MuJoCo's."""

import mujoco
import numpy as np

from drpbench.geometry import host_rotation as rotation
from drpbench.geometry import quaternion_to_matrix


def random_quaternions(count):
    q = np.random.default_rng(0).normal(size=(count, 4))
    return q / np.linalg.norm(q, axis=1, keepdims=True)


def test_matrix_and_product_are_mujocos():
    for a, b in zip(random_quaternions(50), random_quaternions(100)[50:], strict=True):
        expected = np.zeros(9)
        mujoco.mju_quat2Mat(expected, a)
        np.testing.assert_allclose(quaternion_to_matrix(a).ravel(), expected, atol=1e-12)
        product = np.zeros(4)
        mujoco.mju_mulQuat(product, a, b)
        np.testing.assert_allclose(rotation.multiply(a, b), product, atol=1e-12)


def test_from_matrix_inverts_matrix_for_every_pivot():
    halves = [rotation.axis_angle(axis, np.pi) for axis in np.eye(3)]
    for q in [*random_quaternions(200), *halves, np.array([1.0, 0, 0, 0])]:
        found = rotation.from_matrix(quaternion_to_matrix(q))
        assert found[0] >= 0
        assert min(np.abs(found - q).max(), np.abs(found + q).max()) < 1e-9


def test_axis_angle_turns_by_the_right_hand():
    turned = quaternion_to_matrix(rotation.axis_angle((0, 0, 2), np.pi / 2)) @ (1, 0, 0)
    np.testing.assert_allclose(turned, (0, 1, 0), atol=1e-12)
