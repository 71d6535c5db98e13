"""What a policy sees, and nothing else."""

from dataclasses import dataclass

import jax
from jaxtyping import Array, Bool, Float

from drpbench.geometry import Primitives

SCENE_POINTS = 2048
ROBOT_POINTS = 256


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Observation:
    """One observation, in the world frame (the arm's base), SI units, batched over leading axes.

    Scene points are the same points of the same surfaces throughout an episode: one that moves between
    two observations is on a moving obstacle. Where `scene_mask` is false there is no point (its
    coordinates are zero).
    """

    joint_position: Float[Array, "*batch 7"]
    joint_velocity: Float[Array, "*batch 7"]
    goal_joints: Float[Array, "*batch 7"]
    goal_position: Float[Array, "*batch 3"]
    """Goal of the frame `grip` [m]."""
    goal_quaternion: Float[Array, "*batch 4"]
    """wxyz"""
    scene_points: Float[Array, "*batch 2048 3"]
    scene_mask: Bool[Array, "*batch 2048"]
    robot_points: Float[Array, "*batch 256 3"]
    """Points on the arm's outer surface, always the same ones of it."""
    obstacles: Primitives | None = None
    """Every obstacle as it is now; None unless the policy is privileged."""
