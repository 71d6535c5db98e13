"""The arm's motion against C MuJoCo with the same model file."""

import jax
import mujoco
import numpy as np
import pytest

from drpbench.compile import jit
from drpbench.contract import EPISODE
from drpbench.envs.dynamics import SUBSTEPS, substep
from drpbench.robot import PANDA

EPISODES, STEPS = 16, 200
STOP_STIFFNESS = 2000.0  # [N m/rad] docs/protocol.md
KP, KD, DAMPING = 1000.0, 50.0, 1.0  # [N m/rad], [N m s/rad] twice
SUBSTEP = EPISODE.period / SUBSTEPS


@pytest.fixture(scope="module")
def model():
    return mujoco.MjModel.from_xml_path(str(PANDA.model))


@pytest.fixture(scope="module")
def simulate():
    """Positions and velocities (B, 200, 7) from starts (B, 7), targets and torques (B, 200, 7)."""

    def episode(q, qd, targets, torques):
        def step(motion, command):
            motion = substep(*motion, *command)
            return motion, motion

        return jax.lax.scan(step, (q, qd), (targets, torques))[1]

    compiled = jit(jax.vmap(episode))

    def run(*arrays):
        assert all(a.shape[0] == EPISODES for a in arrays)
        return tuple(
            np.asarray(a, float) for a in compiled(*(np.asarray(a, np.float32) for a in arrays))
        )

    return run


def in_c(model, q, qd, targets, torques):
    """The same by mj_step, and whether any servo was at its torque limit (B, 200)."""
    data = mujoco.MjData(model)
    position, velocity = np.empty_like(targets), np.empty_like(targets)
    limited = np.empty(targets.shape[:2], bool)
    for b in range(EPISODES):
        mujoco.mj_resetData(model, data)
        data.qpos, data.qvel = q[b], qd[b]
        for t in range(STEPS):
            data.ctrl = targets[b, t]
            data.qfrc_applied = torques[b, t] - STOP_STIFFNESS * beyond(data.qpos)
            mujoco.mj_step(model, data)
            limited[b, t] = (np.abs(data.actuator_force) >= 0.999 * PANDA.torque_limit).any()
            position[b, t], velocity[b, t] = data.qpos, data.qvel
    return position, velocity, limited


def by_formula(model, q, qd, targets, torques):
    """Positions by the formula in `substep`'s docstring, mass matrix and bias from C MuJoCo."""
    data, h = mujoco.MjData(model), model.opt.timestep
    mass, positions = np.empty((7, 7), order="F"), np.empty_like(targets)
    for b in range(EPISODES):
        position, velocity = np.array(q[b], float), np.array(qd[b], float)
        for t in range(STEPS):
            data.qpos, data.qvel = position, velocity
            mujoco.mj_forward(model, data)
            for column, unit in zip(mass.T, np.eye(7), strict=True):
                mujoco.mj_mulM(model, data, column, unit)
            aim = np.clip(targets[b, t], PANDA.joint_lower, PANDA.joint_upper)
            servo = np.clip(
                KP * (aim - position) - KD * velocity, -PANDA.torque_limit, PANDA.torque_limit
            )
            force = servo + torques[b, t] - STOP_STIFFNESS * beyond(position)
            force -= DAMPING * velocity + data.qfrc_bias
            inertia = mass + h * (KD + DAMPING) * np.eye(7)
            velocity = velocity + h * np.linalg.solve(inertia, force)
            position = position + h * velocity
            positions[b, t] = position
    return positions


def beyond(q):
    return q - np.clip(q, PANDA.joint_lower, PANDA.joint_upper)


def walking_targets(rng, share):
    """Random starts, and targets that walk from there at up to `share` of the velocity limits."""
    start = rng.uniform(PANDA.joint_lower + 0.3, PANDA.joint_upper - 0.3, (EPISODES, 7))
    legs = rng.uniform(-share, share, (EPISODES, 4, 7)) * PANDA.velocity_limit * SUBSTEP
    targets = start[:, None] + np.cumsum(np.repeat(legs, STEPS // 4, axis=1), axis=1)
    return start, np.clip(targets, PANDA.joint_lower, PANDA.joint_upper)


def test_two_substeps_are_one_control_step(model):
    assert model.opt.timestep == pytest.approx(SUBSTEP, rel=1e-12)
    assert pytest.approx(1.0 / 60.0) == EPISODE.period


@pytest.mark.slow
def test_motion_within_the_torque_limits_is_that_of_c_mujoco(simulate, model):
    rng = np.random.default_rng(0)
    q, targets = walking_targets(rng, 0.2)
    qd = rng.uniform(-0.1, 0.1, q.shape)
    torques = np.repeat(rng.uniform(-0.1, 0.1, (EPISODES, 4, 7)), STEPS // 4, axis=1)
    torques *= PANDA.torque_limit
    position, velocity = simulate(q, qd, targets, torques)
    expected, expected_velocity, limited = in_c(model, q, qd, targets, torques)
    assert not limited.any()
    assert np.ptp(expected, axis=1).max(axis=1).min() > 0.1  # every arm moved
    np.testing.assert_allclose(position, expected, atol=3e-6)
    np.testing.assert_allclose(velocity, expected_velocity, atol=1e-4)


@pytest.mark.slow
def test_motion_at_the_torque_limits_is_by_the_formula(simulate, model):
    rng = np.random.default_rng(1)
    q, targets = walking_targets(rng, 1.0)
    qd = rng.uniform(-1.0, 1.0, q.shape) * PANDA.velocity_limit
    torques = np.zeros_like(targets)
    assert in_c(model, q, qd, targets, torques)[2].mean() > 0.1
    position, _ = simulate(q, qd, targets, torques)
    expected = by_formula(model, q, qd, targets, torques)
    np.testing.assert_allclose(position, expected, atol=1e-4)


def test_a_servo_pushes_with_its_torque_limit_and_no_more(simulate):
    """From rest the servo beyond its limit moves the arm exactly as the torque limit does."""
    rng = np.random.default_rng(2)
    q = rng.uniform(PANDA.joint_lower + 0.5, PANDA.joint_upper - 0.5, (EPISODES, 7))
    sign = rng.choice([-1.0, 1.0], q.shape)
    still, rest = np.zeros((EPISODES, STEPS, 7)), np.zeros_like(q)
    here = still + q[:, None]
    just, far = here + 0.1 * sign[:, None], here + 0.4 * sign[:, None]
    pushed = still + (sign * PANDA.torque_limit)[:, None]
    first = [
        simulate(q, rest, targets, torques)[1][:, 0]
        for targets, torques in ((just, still), (far, still), (here, pushed))
    ]
    np.testing.assert_array_equal(first[0], first[1])
    np.testing.assert_allclose(first[0], first[2], rtol=2e-3, atol=2e-3)


def test_joints_stop_at_their_limits(simulate):
    """Thrown at a limit, or leaning on it with half the servo's torque, a joint stays near it."""
    rng = np.random.default_rng(3)
    upper = rng.random((EPISODES, 7)) < 0.5
    limit = np.where(upper, PANDA.joint_upper, PANDA.joint_lower)
    inward = np.where(upper, -1.0, 1.0)
    q = limit + 0.05 * inward
    targets = np.zeros((EPISODES, STEPS, 7)) + limit[:, None]
    thrown, _ = simulate(q, -inward * PANDA.velocity_limit, targets, np.zeros_like(targets))
    leaning, _ = simulate(
        q, np.zeros_like(q), targets, targets * 0.0 - 0.5 * (inward * PANDA.torque_limit)[:, None]
    )
    assert np.abs(beyond(thrown)).max() < 0.08
    assert np.abs(beyond(thrown[:, -1])).max() < 1e-3
    held = 0.5 * PANDA.torque_limit / (STOP_STIFFNESS + KP)
    np.testing.assert_allclose(
        np.abs(beyond(leaning[:, -1])), np.tile(held, (EPISODES, 1)), rtol=0.05
    )


def test_an_arm_at_rest_on_its_target_stays_there(simulate):
    q = np.random.default_rng(4).uniform(PANDA.joint_lower, PANDA.joint_upper, (EPISODES, 7))
    q = q.astype(np.float32)
    still = np.zeros((EPISODES, STEPS, 7))
    position, velocity = simulate(q, np.zeros_like(q), still + q[:, None], still)
    np.testing.assert_allclose(position, still + q[:, None], atol=1e-6)
    np.testing.assert_allclose(velocity, still, atol=1e-5)
