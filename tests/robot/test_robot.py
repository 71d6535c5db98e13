"""The arm as a value: equal where it is the same, and its methods compiled once."""

import pickle
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from drpbench.robot import PANDA, Robot
from drpbench.robot.arms import arm

HOME = jnp.asarray(PANDA.home, jnp.float32)


def test_equal_arms_share_a_compiled_program():
    again = pickle.loads(pickle.dumps(PANDA))
    assert again == PANDA and hash(again) == hash(PANDA)
    assert arm("panda") == PANDA != arm("panda", 0.01)
    assert replace(PANDA, joint_upper=PANDA.joint_upper + 0.1) != PANDA

    traced = []

    def reach(robot, q):
        traced.append(robot)
        return robot.grip_pose(robot.link_poses(q))[0]

    compiled = jax.jit(reach, static_argnums=0)
    for robot in (PANDA, again, PANDA):
        compiled(robot, HOME)
    assert len(traced) == 1


def test_what_an_arm_is_made_of_cannot_be_written_on():
    with pytest.raises(ValueError, match="read-only"):
        PANDA.joint_lower[0] = 0.0


@pytest.mark.parametrize("method", ["link_poses", "grip_pose", "grip_jacobian", "self_clearance"])
def test_a_loop_outside_jit_compiles_a_method_once(method):
    robot = replace(PANDA, name="another")  # that nothing has been compiled for
    compiled = vars(Robot)[method]
    before = compiled._cache_size()
    for offset in np.linspace(0.0, 0.5, 4, dtype=np.float32):
        given = HOME + offset
        getattr(robot, method)(given if method == "link_poses" else robot.link_poses(given))
    assert compiled._cache_size() == before + 1
