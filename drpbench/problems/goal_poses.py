"""Goal poses from goal joints, where a problem states the joints alone."""

import jax
import jax.numpy as jnp
import numpy as np

from drpbench.geometry import matrix_to_quaternion
from drpbench.robot import Robot


def goal_poses(robot: Robot, joints: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Positions (n, 3) [m] and quaternions (n, 4), wxyz, of `grip` at joint positions (n, J)
    [rad]."""
    position, rotation = jax.vmap(lambda q: robot.grip_pose(robot.link_poses(q)))(
        jnp.asarray(joints, jnp.float32)
    )
    return np.asarray(position), np.asarray(matrix_to_quaternion(rotation))
