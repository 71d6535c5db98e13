"""The constants in `panda.py` against the two models of the arm."""

import mujoco
import numpy as np
import pytest

from drpbench.robot import PANDA
from drpbench.robot.arms.panda.fingers import FINGER_OPENING


@pytest.fixture(scope="module")
def own():
    return mujoco.MjModel.from_xml_path(str(PANDA.model))


@pytest.fixture(scope="module")
def real():
    path = PANDA.meshes.find()
    if path is None:
        pytest.skip(PANDA.meshes.absent)
    return mujoco.MjModel.from_xml_path(str(path))


@pytest.fixture(params=["real", "own"])
def model(request):
    """The real arm's model, then the package's own."""
    return request.getfixturevalue(request.param)


def test_links_are_the_bodies_in_order(model):
    assert tuple(model.body(i).name for i in range(1, model.nbody)) == PANDA.link_names


def test_joint_limits_agree(model):
    limits = np.stack([PANDA.joint_lower, PANDA.joint_upper], axis=1)
    np.testing.assert_array_equal(model.jnt_range[:7], limits)
    np.testing.assert_array_equal(model.actuator_ctrlrange[:7], limits)
    assert model.jnt_limited[:7].all() and model.actuator_ctrllimited[:7].all()


def test_torque_limits_agree(model):
    limits = np.stack([-PANDA.torque_limit, PANDA.torque_limit], axis=1)
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
    assert np.all(PANDA.home > PANDA.joint_lower + 0.1) and np.all(
        PANDA.home < PANDA.joint_upper - 0.1
    )
    assert PANDA.velocity_limit.shape == PANDA.home.shape and np.all(PANDA.velocity_limit > 0.0)
