"""The arm's motion: MuJoCo MJX, two substeps a control step, position servos with torque limits."""

import contextlib
import io
from functools import cache

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from drpbench.contract import CONTROL_PERIOD
from drpbench.robot import PANDA

with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
    from mujoco import mjx  # says on import that its optional Warp backend is not installed

SUBSTEPS = 2
_STOP_STIFFNESS = 2000.0  # [N m/rad] of the mechanical stops at the joint limits


@cache
def _model() -> tuple[mjx.Model, mjx.Data]:
    spec = PANDA.spec()
    spec.compiler.fusestatic = True  # hand and fingers become part of link7
    model = spec.compile()
    assert abs(model.opt.timestep * SUBSTEPS - CONTROL_PERIOD) < 1e-9
    with jax.ensure_compile_time_eval():
        device_model = mjx.put_model(model)
        return device_model, mjx.make_data(device_model)


def substep(
    joint_position: Float[Array, "7"],
    joint_velocity: Float[Array, "7"],
    target: Float[Array, "7"],
    torque: Float[Array, "7"],
) -> tuple[Float[Array, "7"], Float[Array, "7"]]:
    """Joint positions [rad] and velocities [rad/s] after 1/120 s.

    `target` [rad] is what the servos (kp 1000, kd 50) aim at; `torque` [N m] acts besides them.
    With h the time step, b the joints' damping and c(q, qd) the Coriolis and centrifugal forces,

        (M(q) + h (kd + b)) (qd' - qd) / h = clip(kp (target - q) - kd qd) + torque + stops - b qd - c
        q' = q + h qd'

    C MuJoCo takes the same step while no servo is at its torque limit. At the limit it leaves kd out of
    the matrix; MJX does not, so that a limited joint speeds up as if h kd = 0.42 kg m^2 heavier.
    """
    model, data = _model()
    beyond = joint_position - jnp.clip(joint_position, PANDA.joint_lower, PANDA.joint_upper)
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
