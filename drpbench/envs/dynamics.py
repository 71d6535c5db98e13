"""The arm's motion: MuJoCo MJX, two substeps a control step, position servos with torque limits."""

import contextlib
import io
from functools import cache

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from drpbench.contract import EPISODE
from drpbench.robot import PANDA, Robot

with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
    from mujoco import mjx  # says on import that its optional Warp backend is not installed

SUBSTEPS = 2
_STOP_STIFFNESS = 2000.0  # [N m/rad] of the mechanical stops at the joint limits


@cache
def _model(robot: Robot, control_period: float) -> tuple[mjx.Model, mjx.Data]:
    spec = robot.spec()
    spec.compiler.fusestatic = True  # hand and fingers become part of the last joint's link
    spec.option.timestep = control_period / SUBSTEPS
    model = spec.compile()
    with jax.ensure_compile_time_eval():
        device_model = mjx.put_model(model)
        return device_model, mjx.make_data(device_model)


def substep(
    joint_position: Float[Array, " J"],
    joint_velocity: Float[Array, " J"],
    target: Float[Array, " J"],
    torque: Float[Array, " J"],
    robot: Robot = PANDA,
    control_period: float = EPISODE.period,
) -> tuple[Float[Array, " J"], Float[Array, " J"]]:
    """Joint positions [rad] and velocities [rad/s] after half a control period [s].

    `target` [rad] is what the servos (of the Panda: kp 1000, kd 50) aim at; `torque` [N m] acts
    besides them. With h the time step, b the joints' damping and c(q, qd) the Coriolis and
    centrifugal forces,

        (M(q) + h (kd + b)) (qd' - qd) / h
            = clip(kp (target - q) - kd qd) + torque + stops - b qd - c
        q' = q + h qd'

    C MuJoCo takes the same step while no servo is at its torque limit. At the limit it leaves kd
    out of the matrix; MJX does not, so that a limited joint speeds up as if h kd = 0.42 kg m^2
    heavier.
    """
    model, data = _model(robot, control_period)
    beyond = joint_position - jnp.clip(joint_position, robot.joint_lower, robot.joint_upper)
    data = data.replace(
        qpos=joint_position,
        qvel=joint_velocity,
        ctrl=target,
        qfrc_applied=torque - _STOP_STIFFNESS * beyond,
    )
    # TF32, the default on NVIDIA GPUs, would round inertias to three digits.
    with jax.default_matmul_precision("highest"):
        data = mjx.step(model, data)
    return data.qpos, data.qvel
