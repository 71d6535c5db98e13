"""The constants in `panda.py` against the two models of the arm."""

import mujoco
import numpy as np
import pytest

from drpbench.robot import (
    HOME,
    JOINT_LOWER,
    JOINT_UPPER,
    LINKS,
    NO_MESHES,
    PANDA_XML,
    TORQUE_LIMIT,
    VELOCITY_LIMIT,
    find_mesh_model,
)
from drpbench.robot.arms.panda import FINGER_OPENING


@pytest.fixture(scope="module")
def own():
    return mujoco.MjModel.from_xml_path(str(PANDA_XML))


@pytest.fixture(scope="module")
def real():
    path = find_mesh_model()
    if path is None:
        pytest.skip(NO_MESHES)
    return mujoco.MjModel.from_xml_path(str(path))


@pytest.fixture(params=["real", "own"])
def model(request):
    """The real arm's model, then the package's own."""
    return request.getfixturevalue(request.param)


def test_links_are_the_bodies_in_order(model):
    assert tuple(model.body(i).name for i in range(1, model.nbody)) == LINKS


def test_joint_limits_agree(model):
    limits = np.stack([JOINT_LOWER, JOINT_UPPER], axis=1)
    np.testing.assert_array_equal(model.jnt_range[:7], limits)
    np.testing.assert_array_equal(model.actuator_ctrlrange[:7], limits)
    assert model.jnt_limited[:7].all() and model.actuator_ctrllimited[:7].all()


def test_torque_limits_agree(model):
    limits = np.stack([-TORQUE_LIMIT, TORQUE_LIMIT], axis=1)
    np.testing.assert_array_equal(model.actuator_forcerange[:7], limits)
    assert model.actuator_forcelimited[:7].all()


def test_every_joint_has_its_servo(own):
    assert own.nq == own.nv == own.nu == 7
    np.testing.assert_array_equal(own.actuator_trnid[:, 0], np.arange(7))
    np.testing.assert_array_equal(own.actuator_gainprm[:, 0], 1000.0)
    np.testing.assert_array_equal(own.actuator_biasprm[:, :3], [[0.0, -1000.0, -50.0]] * 7)


def test_own_model_has_neither_geoms_nor_gravity(own):
    assert own.ngeom == 0 and own.nmesh == 0
    np.testing.assert_array_equal(own.opt.gravity, 0.0)


def test_fingers_of_the_own_model_are_fixed_open(own):
    left, right = own.body("left_finger"), own.body("right_finger")
    assert left.pos[1] == -right.pos[1] == FINGER_OPENING
    assert left.pos[2] == right.pos[2] == 0.0584
    np.testing.assert_allclose(np.abs(right.quat), [0.0, 0.0, 0.0, 1.0], atol=1e-12)


def test_home_is_inside_the_limits():
    assert np.all(HOME > JOINT_LOWER + 0.1) and np.all(HOME < JOINT_UPPER - 0.1)
    assert VELOCITY_LIMIT.shape == HOME.shape and np.all(VELOCITY_LIMIT > 0.0)
