"""What the environments show and take: the benchmark's observation and joint targets, as spaces."""

from dataclasses import fields

import numpy as np
from gymnasium.spaces import Box, Dict, Space

from drpbench.contract import ROBOT_POINTS, SCENE_POINTS, Observation
from drpbench.robot import Robot

# Wide enough to hold all that happens; they are no scales to normalise by.
_JOINTS = 5.0  # [rad] contact pushes a joint past its limit, against stiff stops
_SPEED = 100.0  # [rad/s]
_ROOM = 5.0  # [m]
_SHOWN = tuple(field.name for field in fields(Observation) if field.name != "obstacles")


def action_space(robot: Robot) -> Box:
    """Absolute joint position targets [rad], within the joint limits."""
    return Box(robot.joint_lower.astype(np.float32), robot.joint_upper.astype(np.float32))


def observation_space(robot: Robot) -> Space:
    """The fields of `drpbench.contract.Observation`: world frame, metres, radians, quaternions wxyz."""

    def within(bound: float, *shape: int) -> Box:
        return Box(-bound, bound, shape, np.float32)

    return Dict(
        {
            "joint_position": within(_JOINTS, robot.joints),
            "joint_velocity": within(_SPEED, robot.joints),
            "goal_joints": within(_JOINTS, robot.joints),
            "goal_position": within(_ROOM, 3),
            "goal_quaternion": within(1.001, 4),  # a unit quaternion, rounded
            "scene_points": within(_ROOM, SCENE_POINTS, 3),
            "scene_mask": Box(0, 1, (SCENE_POINTS,), np.bool_),
            "robot_points": within(_ROOM, ROBOT_POINTS, 3),
        }
    )


def as_dict(observation: Observation) -> dict[str, np.ndarray]:
    """An observation as arrays in host memory that are the caller's own, to keep or to write to."""
    return {name: np.array(getattr(observation, name)) for name in _SHOWN}
