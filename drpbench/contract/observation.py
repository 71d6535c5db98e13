"""What a policy sees, and nothing else."""

from collections.abc import Mapping
from dataclasses import dataclass

import jax
import numpy as np
from jaxtyping import Array, Bool, Float

from drpbench.geometry import Primitives
from drpbench.robot import PANDA, Robot

SCENE_POINTS = 2048
ROBOT_POINTS = 256

# Wide enough to hold all that happens; they are no scales to normalise by. Contact pushes a joint
# past its limit, against stiff stops.
_JOINTS, _PAST_LIMIT = 5.0, 1.3  # [rad] at least; times the largest limit
_SPEED = 100.0  # [rad/s]
_ROOM = 5.0  # [m]
_UNIT = 1.001  # a unit quaternion's components, rounded


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Observation:
    """One observation, in the world frame (the arm's base), SI units, batched over leading axes.

    J joints, N scene points, R points of the arm; `observation_spec` says how many, and what each
    field means. Scene points are the same points of the same surfaces throughout an episode: one
    that moves between two observations is on a moving obstacle. Where `scene_mask` is false there
    is no point (its coordinates are zero).
    """

    joint_position: Float[Array, "*batch J"]
    joint_velocity: Float[Array, "*batch J"]
    goal_joints: Float[Array, "*batch J"]
    goal_position: Float[Array, "*batch 3"]
    """Goal of the frame `grip` [m]."""
    goal_quaternion: Float[Array, "*batch 4"]
    """wxyz"""
    scene_points: Float[Array, "*batch N 3"]
    scene_mask: Bool[Array, "*batch N"]
    robot_points: Float[Array, "*batch R 3"]
    """Points on the arm's outer surface, always the same ones of it."""
    obstacles: Primitives | None = None
    """Every obstacle as it is now; None unless the policy is privileged."""


@dataclass(frozen=True)
class ArraySpec:
    """One field of an observation, without its batch axes."""

    shape: tuple[int, ...]
    dtype: np.dtype
    bound: float
    """No entry is larger than this in size; 1 for booleans."""
    unit: str
    """Empty where there is none."""
    meaning: str


Spec = Mapping[str, ArraySpec]
"""The fields of an observation by name, in the order in which `Observation` has them."""


def observation_spec(
    robot: Robot = PANDA, scene_points: int = SCENE_POINTS, robot_points: int = ROBOT_POINTS
) -> dict[str, ArraySpec]:
    """What a policy for `robot` sees. The one list of an observation's fields.

    `obstacles`, which only a privileged policy gets, is no array and not in it.
    """
    real, truth = np.dtype(np.float32), np.dtype(np.bool_)
    limits = np.abs([robot.joint_lower, robot.joint_upper])
    joints = max(_JOINTS, _PAST_LIMIT * float(limits.max()))
    j, n, r = (robot.joints,), (scene_points,), (robot_points,)
    return {
        "joint_position": ArraySpec(j, real, joints, "rad", "where the joints are"),
        "joint_velocity": ArraySpec(j, real, _SPEED, "rad/s", "how fast they turn"),
        "goal_joints": ArraySpec(j, real, joints, "rad", "a configuration that reaches the goal"),
        "goal_position": ArraySpec((3,), real, _ROOM, "m", "goal of the frame grip"),
        "goal_quaternion": ArraySpec((4,), real, _UNIT, "", "goal of the frame grip, wxyz"),
        "scene_points": ArraySpec(
            (*n, 3), real, _ROOM, "m", "the same points of the same surfaces throughout"
        ),
        "scene_mask": ArraySpec(n, truth, 1.0, "", "false where there is no point"),
        "robot_points": ArraySpec((*r, 3), real, _ROOM, "m", "on the arm's outer surface"),
    }


OBSERVED = tuple(observation_spec())
"""Names of the fields that every policy gets."""
