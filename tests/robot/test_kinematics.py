"""Forward kinematics, Jacobians and inertia against C MuJoCo on the real arm's model."""

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest

from drpbench.compile import jit
from drpbench.robot import PANDA, point_jacobian
from drpbench.robot.arms.panda.fingers import FINGER_OPENING

FRAMES = PANDA.link_names[:9]  # the frames of LinkPoses: link0 to link7 and the hand
GRIP = np.array([0.0, 0.0, 0.1])  # [m] in the hand frame


def configurations(count, seed=0):
    """Uniform within the joint limits, as the float32 values that JAX sees."""
    q = np.random.default_rng(seed).uniform(PANDA.joint_lower, PANDA.joint_upper, (count, 7))
    return q.astype(np.float32)


def place(model, data, q):
    """Put the arm at `q` with the fingers open."""
    data.qpos[:] = FINGER_OPENING
    data.qpos[:7] = q
    mujoco.mj_kinematics(model, data)


def angle_between(first, second):
    """Angle [rad] between rotation matrices (..., 3, 3), exact for small angles."""
    chord = np.linalg.norm(first - second, axis=(-2, -1))  # |A - B| = 2 sqrt(2) sin(angle / 2)
    return 2.0 * np.arcsin(np.minimum(chord / np.sqrt(8.0), 1.0))


@pytest.fixture(scope="module")
def real():
    path = PANDA.meshes.find()
    if path is None:
        pytest.skip(PANDA.meshes.absent)
    return mujoco.MjModel.from_xml_path(str(path))


@pytest.fixture(scope="module")
def own():
    return mujoco.MjModel.from_xml_path(str(PANDA.model))


@pytest.fixture(params=["real", "own"])
def model(request):
    """The real arm's model, then the package's own."""
    return request.getfixturevalue(request.param)


def test_frames_agree_with_mujoco_over_10000_configurations(model):
    q = configurations(10_000)

    @jit
    @jax.vmap
    def forward(q):
        poses = PANDA.link_poses(q)
        return poses.position, poses.rotation, *PANDA.grip_pose(poses)

    found_position, found_rotation, grip_position, grip_rotation = map(np.asarray, forward(q))
    data = mujoco.MjData(model)
    bodies = [model.body(name).id for name in FRAMES]
    position = np.empty((len(q), 9, 3))
    rotation = np.empty((len(q), 9, 3, 3))
    for i, row in enumerate(q):
        place(model, data, row)
        position[i] = data.xpos[bodies]
        rotation[i] = data.xmat[bodies].reshape(9, 3, 3)

    assert np.abs(found_position - position).max() < 1e-5
    assert angle_between(found_rotation, rotation).max() < 1e-5
    expected = position[:, 8] + rotation[:, 8] @ GRIP
    assert np.abs(grip_position - expected).max() < 1e-5
    assert angle_between(grip_rotation, rotation[:, 8]).max() < 1e-5


def test_own_model_marks_the_grip_frame(own):
    q = configurations(100, seed=5)
    found_position, found_rotation = map(
        np.asarray, jit(jax.vmap(lambda q: PANDA.grip_pose(PANDA.link_poses(q))))(q)
    )
    data = mujoco.MjData(own)
    for row, position, rotation in zip(q, found_position, found_rotation, strict=True):
        place(own, data, row)
        np.testing.assert_allclose(data.site("grip").xpos, position, atol=1e-5)
        np.testing.assert_allclose(data.site("grip").xmat.reshape(3, 3), rotation, atol=1e-5)


def test_jacobians_agree_with_mujoco(model):
    q = configurations(1_000, seed=1)
    rng = np.random.default_rng(2)
    local = rng.uniform(-0.2, 0.2, (len(q), 3)).astype(np.float32)
    frame = rng.integers(0, 9, len(q)).astype(np.int32)

    @jit
    @jax.vmap
    def jacobians(q, local, frame):
        poses = PANDA.link_poses(q)
        point = poses.position[frame] + poses.rotation[frame] @ local
        return PANDA.grip_jacobian(poses), point, point_jacobian(poses, point, frame)

    grip, point, at_point = map(np.asarray, jacobians(q, local, frame))
    data = mujoco.MjData(model)
    bodies = [model.body(name).id for name in FRAMES]
    linear, angular = np.empty((2, 3, model.nv))
    for i, row in enumerate(q):
        place(model, data, row)
        mujoco.mj_comPos(model, data)
        hand = bodies[8]
        tip = data.xpos[hand] + data.xmat[hand].reshape(3, 3) @ GRIP
        mujoco.mj_jac(model, data, linear, angular, tip, hand)
        np.testing.assert_allclose(grip[i, :3], linear[:, :7], atol=1e-5)
        np.testing.assert_allclose(grip[i, 3:], angular[:, :7], atol=1e-5)
        mujoco.mj_jac(model, data, linear, None, point[i].astype(float), bodies[frame[i]])
        np.testing.assert_allclose(at_point[i], linear[:, :7], atol=1e-5)


def test_jacobians_are_the_derivatives_of_the_kinematics():
    q = configurations(200, seed=3)
    local = jnp.array([0.02, -0.03, 0.05])

    @jit
    @jax.vmap
    def compare(q):
        poses = PANDA.link_poses(q)
        position_slope = jax.jacfwd(lambda q: PANDA.link_poses(q).position)(q)
        rotation_slope = jax.jacfwd(lambda q: PANDA.link_poses(q).rotation)(q)
        points = poses.position + poses.rotation @ local
        closed = jnp.stack([point_jacobian(poses, points[i], i) for i in range(9)])
        automatic = position_slope + jnp.einsum("fabj,b->faj", rotation_slope, local)
        # dR/dq_j = [w_j]x R, so w_j is the vector of the skew matrix dR/dq_j R^T.
        skew = jnp.einsum("abj,cb->acj", rotation_slope[8], poses.rotation[8])
        spin = jnp.stack([skew[2, 1], skew[0, 2], skew[1, 0]])
        tip = position_slope[8] + jnp.einsum("abj,b->aj", rotation_slope[8], GRIP)
        return closed, automatic, PANDA.grip_jacobian(poses), jnp.concatenate([tip, spin])

    closed, automatic, grip_closed, grip_automatic = map(np.asarray, compare(q))
    np.testing.assert_allclose(closed, automatic, atol=1e-5)
    np.testing.assert_allclose(grip_closed, grip_automatic, atol=1e-5)


@pytest.mark.parametrize("armature", [True, False], ids=["with armature", "links alone"])
def test_mass_matrix_agrees_with_the_real_arm(real, armature):
    own = mujoco.MjModel.from_xml_path(str(PANDA.model))
    real = mujoco.MjModel.from_xml_path(str(PANDA.meshes.find()))
    if not armature:  # it would hide the wrist's own inertia
        own.dof_armature[:] = real.dof_armature[:] = 0.0

    def mass_matrix(model, data, q):
        place(model, data, q)
        mujoco.mj_comPos(model, data)
        mujoco.mj_crb(model, data)
        columns = np.empty((model.nv, model.nv))
        for column, unit in zip(columns, np.eye(model.nv), strict=True):
            mujoco.mj_mulM(model, data, column, unit)
        return columns[:7, :7]

    own_data, real_data = mujoco.MjData(own), mujoco.MjData(real)
    for q in configurations(1_000, seed=4):
        ours, theirs = mass_matrix(own, own_data, q), mass_matrix(real, real_data, q)
        assert np.linalg.norm(ours - theirs) < 0.01 * np.linalg.norm(theirs)
        assert np.all(np.abs(np.diag(ours) - np.diag(theirs)) < 0.01 * np.diag(theirs))
        # Closer than asked, because both carry the same published inertias.
        assert np.abs(ours - theirs).max() < 1e-6


def test_joints_of_the_own_model_brake_like_the_real_arms(own, real):
    np.testing.assert_allclose(own.dof_damping, real.dof_damping[:7])
    np.testing.assert_allclose(own.dof_armature, real.dof_armature[:7])
