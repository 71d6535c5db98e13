"""Batched inverse kinematics: joint configurations that put the frame `grip` into a pose.

Damped least squares (Wampler, 1986; Nakamura and Hanafusa, 1986) with Levenberg and Marquardt's
rule for the damping. With e = (p* - p, log(R* R^T)) and J the geometric Jacobian of the grip,

    dq = J^T (J J^T + damping I)^-1 e

Joints at a limit that the step would push farther are left out of J and the step taken again.
"""

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, PRNGKeyArray

from drpbench.geometry import quaternion_to_matrix
from drpbench.robot import PANDA, Robot

from .joint_limits import inner_limits

POSITION_TOLERANCE = 1e-4  # [m]
ORIENTATION_TOLERANCE = 1e-3  # [rad]
_ITERATIONS = 40
_STEP = 0.5  # [rad] that a joint moves at most in one


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Solutions:
    """Configurations `q` [rad] for one pose, one a seed, with what is left of the errors.

    `position_error` [m], `orientation_error` [rad]; `converged` where both are within tolerance.
    All keep `LIMIT_MARGIN` from the joint limits.
    """

    q: Float[Array, "*batch S J"] | Float[np.ndarray, "*batch S J"]
    position_error: Float[Array, "*batch S"] | Float[np.ndarray, "*batch S"]
    orientation_error: Float[Array, "*batch S"] | Float[np.ndarray, "*batch S"]
    converged: Bool[Array, "*batch S"] | Bool[np.ndarray, "*batch S"]


def rotation_vector(rotation: Float[Array, "3 3"]) -> Float[Array, "3"]:
    """Axis times angle [rad] of a rotation matrix, for angles up to a half turn.

    Its skew part is sin(angle) times the axis, its trace 1 + 2 cos(angle). Near a half turn the
    sine vanishes, and the axis is taken from the symmetric part, (1 - cos(angle)) axis axis^T.
    """
    skew = 0.5 * jnp.stack(
        [
            rotation[2, 1] - rotation[1, 2],
            rotation[0, 2] - rotation[2, 0],
            rotation[1, 0] - rotation[0, 1],
        ]
    )
    sine = jnp.sqrt(jnp.sum(skew * skew))
    cosine = 0.5 * (jnp.trace(rotation) - 1.0)
    angle = jnp.arctan2(sine, cosine)
    symmetric = 0.5 * (rotation + rotation.T) - cosine * jnp.eye(3)
    lengths = jnp.sum(symmetric * symmetric, axis=0)
    column = symmetric[:, jnp.argmax(lengths)]
    column = column * jnp.where(jnp.sum(column * skew) < 0.0, -1.0, 1.0)
    about = column / jnp.sqrt(jnp.maximum(jnp.max(lengths), 1e-12))
    half_turn = (cosine < 0.0) & (sine < 1e-2)
    scale = jnp.where(sine > 1e-6, angle / jnp.maximum(sine, 1e-6), 1.0)
    return jnp.where(half_turn, angle * about, scale * skew)


def _seeds(key, position, count, lower, upper, robot):
    """(S, J) about the home posture, turned towards the position, with any turn of the hand."""
    about_key, hand_key = jax.random.split(key)
    offsets = jax.random.uniform(about_key, (count, robot.joints), minval=-1.0, maxval=1.0)
    seeds = robot.home.astype(np.float32) + robot.home_spread.astype(np.float32) * offsets
    seeds = seeds.at[:, 0].add(jnp.arctan2(position[1], position[0]))
    seeds = seeds.at[:, -1].set(jax.random.uniform(hand_key, (count,), minval=-2.5, maxval=2.5))
    return jnp.clip(seeds, lower, upper)


def solve(
    position: Float[Array, "3"],
    quaternion: Float[Array, "4"],
    key: PRNGKeyArray,
    seeds: int = 16,
    robot: Robot = PANDA,
) -> Solutions:
    """Descends to the grip pose (`position` [m], unit `quaternion` wxyz) from each of `seeds`."""
    wanted = quaternion_to_matrix(quaternion)
    lower, upper = inner_limits(robot, np.float32)

    def errors(q):
        poses = robot.link_poses(q)
        here, rotation = robot.grip_pose(poses)
        turn = jnp.matmul(wanted, rotation.T, precision="highest")
        return jnp.concatenate([position - here, rotation_vector(turn)]), robot.grip_jacobian(poses)

    def damped(jacobian, error, damping):
        square = jnp.matmul(jacobian, jacobian.T, precision="highest") + damping * jnp.eye(6)
        factor = jax.scipy.linalg.cho_factor(square)
        solved = jax.scipy.linalg.cho_solve(factor, error)
        return jnp.matmul(jacobian.T, solved, precision="highest")

    def descend(q):
        def step(_, state):
            q, (error, jacobian), damping = state
            move = damped(jacobian, error, damping)
            held = ((q <= lower) & (move < 0.0)) | ((q >= upper) & (move > 0.0))
            move = damped(jnp.where(held, 0.0, jacobian), error, damping)
            tried = jnp.clip(q + jnp.clip(move, -_STEP, _STEP), lower, upper)
            found = errors(tried)
            better = jnp.sum(found[0] ** 2) < jnp.sum(error**2)
            damping = jnp.clip(jnp.where(better, 0.3 * damping, 5.0 * damping), 1e-6, 10.0)
            keep = jax.tree.map(
                lambda new, old: jnp.where(better, new, old), (tried, found), (q, (error, jacobian))
            )
            return *keep, damping

        q, (error, _), _ = jax.lax.fori_loop(
            0, _ITERATIONS, step, (q, errors(q), jnp.float32(1e-2))
        )
        return q, jnp.sqrt(jnp.sum(error[:3] ** 2)), jnp.sqrt(jnp.sum(error[3:] ** 2))

    q, off, turned = jax.vmap(descend)(_seeds(key, position, seeds, lower, upper, robot))
    converged = (off <= POSITION_TOLERANCE) & (turned <= ORIENTATION_TOLERANCE)
    return Solutions(q, off, turned, converged)
