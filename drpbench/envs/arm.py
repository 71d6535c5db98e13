"""What a task may know of the arm."""

from dataclasses import dataclass, field

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from drpbench.robot import PANDA, Robot


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Arm:
    """Collision spheres (the base left out) in the world frame [m], and where the frame `grip`
    is."""

    centers: Float[Array, "*batch S 3"]
    radii: Float[Array, "*batch S"]
    grip_position: Float[Array, "*batch 3"]
    robot: Robot = field(default=PANDA, metadata={"static": True})

    @classmethod
    def of(cls, robot: Robot, joint_position: Float[Array, " J"]) -> "Arm":
        """What there is to know of a robot at joints [rad]."""
        poses = robot.link_poses(joint_position)
        spheres = robot.moving_spheres
        return cls(
            spheres.world(poses),
            jnp.asarray(spheres.radius),
            robot.grip_pose(poses)[0],
            robot,
        )
