"""Inverse kinematics against MuJoCo's kinematics and the joint limits."""

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from drpbench.compile import jit
from drpbench.geometry import stacked
from drpbench.planning import ik
from drpbench.planning.checker import sphere_checker
from drpbench.planning.joint_limits import LIMIT_MARGIN, inner_limits
from drpbench.planning.path_check import CLEARANCE
from drpbench.planning.pose_goals import nearest_goal
from drpbench.robot import PANDA

from ..scenes import postures

SEEDS = 8


def mujoco_poses(q):
    """Grip positions (n, 3) and rotation matrices (n, 3, 3) of configurations (n, 7)."""
    model = mujoco.MjModel.from_xml_path(str(PANDA.model))
    data = mujoco.MjData(model)
    grip = model.site("grip").id
    poses = []
    for row in np.asarray(q, float):
        data.qpos[:7] = row
        mujoco.mj_kinematics(model, data)
        poses.append((data.site_xpos[grip].copy(), data.site_xmat[grip].reshape(3, 3).copy()))
    positions, matrices = zip(*poses, strict=True)
    return np.stack(positions), np.stack(matrices)


def quaternions(matrices):
    return np.roll(Rotation.from_matrix(matrices).as_quat(), 1, axis=1)


@pytest.fixture(scope="module")
def solve():
    def batched(positions, matrices, seed=0):
        keys = jax.random.split(jax.random.key(seed), len(positions))
        wanted = jnp.asarray(quaternions(matrices), jnp.float32)
        return compiled(jnp.asarray(positions, jnp.float32), wanted, keys)

    compiled = jit(jax.vmap(lambda p, q, key: ik.solve(p, q, key, seeds=SEEDS)))
    return batched


@pytest.fixture(scope="module")
def reachable():
    margin = LIMIT_MARGIN + 0.05
    q = postures(64, seed=1)
    return mujoco_poses(np.clip(q, PANDA.joint_lower + margin, PANDA.joint_upper - margin))


@pytest.mark.slow
def test_what_converged_puts_the_grip_where_mujoco_agrees_it_should_be(solve, reachable):
    positions, matrices = reachable
    found = jax.tree.map(np.asarray, solve(positions, matrices))
    assert found.converged.any(axis=1).mean() > 0.9
    pose, seed = np.nonzero(found.converged)
    there, turned = mujoco_poses(found.q[pose, seed])
    left = Rotation.from_matrix(matrices[pose]) * Rotation.from_matrix(turned).inv()
    assert np.linalg.norm(there - positions[pose], axis=1).max() < 1.1 * ik.POSITION_TOLERANCE
    assert left.magnitude().max() < 1.1 * ik.ORIENTATION_TOLERANCE


@pytest.mark.slow
def test_every_answer_keeps_its_margin_from_the_limits(solve, reachable):
    q = np.asarray(solve(*reachable).q)
    lower, upper = inner_limits(PANDA)
    assert np.all(q >= lower - 1e-5) and np.all(q <= upper + 1e-5)


def test_errors_are_told_as_they_are_where_nothing_converged(solve, reachable):
    positions, matrices = reachable
    found = jax.tree.map(np.asarray, solve(positions + [0.0, 0.0, 2.0], matrices))
    assert not found.converged.any()
    there, turned = mujoco_poses(found.q[:, 0])
    off = np.linalg.norm(there - positions - [0.0, 0.0, 2.0], axis=1)
    left = Rotation.from_matrix(matrices) * Rotation.from_matrix(turned).inv()
    np.testing.assert_allclose(found.position_error[:, 0], off, atol=1e-5)
    np.testing.assert_allclose(found.orientation_error[:, 0], left.magnitude(), atol=2e-3)


def test_seeds_find_different_ways_to_hold_the_hand(solve, reachable):
    found = jax.tree.map(np.asarray, solve(*reachable))
    spread = [
        np.ptp(q[ok], axis=0).max()
        for q, ok in zip(found.q, found.converged, strict=True)
        if ok.sum() > 1
    ]
    assert np.median(spread) > 0.2


def test_the_same_key_gives_the_same_answer(solve, reachable):
    first, second = solve(*reachable, seed=3), solve(*reachable, seed=3)
    np.testing.assert_array_equal(first.q, second.q)


@pytest.mark.parametrize("angle", [0.0, 1e-5, 0.3, 2.0, np.pi - 1e-2, np.pi - 1e-4, np.pi])
def test_rotation_vectors_are_scipys(angle):
    rotation_vector = jax.jit(ik.rotation_vector)
    rng = np.random.default_rng(0)
    for _ in range(20):
        axis = rng.normal(size=3)
        axis /= np.linalg.norm(axis)
        matrix = Rotation.from_rotvec(angle * axis).as_matrix()
        found = np.asarray(rotation_vector(jnp.asarray(matrix, jnp.float32)), float)
        assert np.linalg.norm(found) == pytest.approx(angle, abs=2e-3)
        left = Rotation.from_rotvec(found) * Rotation.from_matrix(matrix).inv()
        assert left.magnitude() < 2e-3


def test_goals_for_poses_are_free_where_the_furniture_leaves_a_way(drawn):
    free = [one for one in drawn if not one.obstructed]

    def stack(name):
        return np.stack([getattr(one, name) for one in free])

    scenes = stacked([one.obstacles for one in free]).primitives()
    positions, matrices = mujoco_poses(stack("goal"))
    keys = jax.random.split(jax.random.key(0), len(free))
    compiled = jit(jax.vmap(nearest_goal))

    def goals(positions):
        wanted = jnp.asarray(quaternions(matrices), jnp.float32)
        found = compiled(scenes, stack("start"), jnp.asarray(positions, jnp.float32), wanted, keys)
        return map(np.asarray, found)

    q, there = goals(positions)
    assert there.all()
    assert np.abs(mujoco_poses(q)[0] - positions).max() < 1.1 * ik.POSITION_TOLERANCE
    checker, clear = sphere_checker(0.02), []
    for one, row in zip(free, q, strict=True):
        checker.set_obstacles(one.obstacles)
        clear.append(checker.clearance(row) >= CLEARANCE - 1e-4)
    assert np.mean(clear) > 0.8
    assert not list(goals(positions + [0.0, 0.0, 2.0]))[1].any()
