"""The Franka Panda: published limits, offsets and inertia. SI units throughout.

Source: Franka Emika's data sheet ("Robot and interface specifications"). The fingers are fixed
open, so they are rigid parts of the hand. The spheres are fitted to the real collision meshes by
`scripts/fit_spheres.py`; docs/architecture.md has the figures.
"""

from functools import cache, partial
from pathlib import Path

import numpy as np

from drpbench.robot.body_points import Link
from drpbench.robot.robot import RealMeshes, Robot

from .figure import figure
from .fingers import FINGER_HEIGHT, FINGER_OPENING
from .mesh_arm import mesh_arm
from .meshes import NO_MESHES, find_mesh_model

_COS45 = 0.7071067811865476

# Distances from joint axes to the arm's farthest points: sums of the published offsets, and 0.28 m
# from the wrist's centre (joints 5 and 6 meet there) to the farthest point of the hand.
_HAND, _FOREARM, _UPPER_ARM = 0.28, np.hypot(0.384, 0.0825), np.hypot(0.316, 0.0825)
_ACCELERATION_LIMIT = np.array([15.0, 7.5, 10.0, 12.5, 15.0, 20.0, 20.0])  # [rad/s^2]


def panda(finger_opening: float = FINGER_OPENING) -> Robot:
    """The Panda, each finger `finger_opening` [m] from the middle: one value for each opening."""
    return _panda(float(finger_opening))


@cache
def _panda(finger_opening: float) -> Robot:
    return Robot(
        name="panda",
        folder=Path(__file__).parent,
        links=(
            *(Link(f"link{frame}", frame) for frame in range(8)),
            Link("hand", 8),
            Link("left_finger", 8, (0.0, finger_opening, FINGER_HEIGHT)),
            Link(
                "right_finger",
                8,
                (0.0, -finger_opening, FINGER_HEIGHT),
                ((-1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, 1.0)),
            ),
        ),
        joint_offset=np.array(
            [
                (0.0, 0.0, 0.333),
                (0.0, 0.0, 0.0),
                (0.0, -0.316, 0.0),
                (0.0825, 0.0, 0.0),
                (-0.0825, 0.384, 0.0),
                (0.0, 0.0, 0.0),
                (0.088, 0.0, 0.0),
            ]
        ),
        joint_twist=0.5 * np.pi * np.array([0.0, -1.0, 1.0, 1.0, -1.0, 1.0, 1.0]),
        hand_offset=np.array([0.0, 0.0, 0.107]),
        hand_rotation=np.array([[_COS45, _COS45, 0.0], [-_COS45, _COS45, 0.0], [0.0, 0.0, 1.0]]),
        grip_offset=0.1,
        joint_lower=np.array([-2.8973, -1.7628, -2.8973, -3.0718, -2.8973, -0.0175, -2.8973]),
        joint_upper=np.array([2.8973, 1.7628, 2.8973, -0.0698, 2.8973, 3.7525, 2.8973]),
        velocity_limit=np.array([2.175, 2.175, 2.175, 2.175, 2.61, 2.61, 2.61]),
        acceleration_limit=_ACCELERATION_LIMIT,
        jerk_limit=500.0 * _ACCELERATION_LIMIT,
        torque_limit=np.array([87.0, 87.0, 87.0, 87.0, 12.0, 12.0, 12.0]),
        home=np.array([0.0, -0.7853981634, 0.0, -2.3561944902, 0.0, 1.5707963268, 0.7853981634]),
        home_spread=np.array([0.5, 0.6, 0.8, 0.6, 0.8, 0.7, 0.0]),
        generation_spread=np.array([0.5, 0.5, 0.7, 0.5, 0.7, 0.6, 0.0]),
        lever=np.array(
            [
                _UPPER_ARM + _FOREARM + _HAND,
                _UPPER_ARM + _FOREARM + _HAND,
                0.0825 + _FOREARM + _HAND,
                _FOREARM + _HAND,
                _HAND,
                _HAND,
                0.12,
            ]
        ),
        servo_lag=0.05,
        # Over random configurations no other pair of frames that is at least two apart ever meets,
        # neither the spheres nor the real meshes; but for the spheres of link5 and link7, whose
        # meshes stay apart.
        self_collision_blocks=(((0, 1, 2), (5, 6, 7, 8)), ((5,), (8,))),
        forearm=3,
        meshes=RealMeshes(
            find_mesh_model, partial(mesh_arm, finger_opening=finger_opening), NO_MESHES
        ),
        figure=figure,
    )
