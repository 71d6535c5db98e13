"""The Franka Panda: names and published limits. SI units throughout.

Source: Franka Emika's data sheet ("Robot and interface specifications"). The fingers are fixed open
at 0.04 m, so they are rigid parts of the hand.
"""

from pathlib import Path

import numpy as np

PANDA_XML = Path(__file__).parent / "panda.xml"

LINKS = tuple(f"link{i}" for i in range(8)) + ("hand", "left_finger", "right_finger")

JOINT_LOWER = np.array([-2.8973, -1.7628, -2.8973, -3.0718, -2.8973, -0.0175, -2.8973])  # [rad]
JOINT_UPPER = np.array([2.8973, 1.7628, 2.8973, -0.0698, 2.8973, 3.7525, 2.8973])  # [rad]
VELOCITY_LIMIT = np.array([2.175, 2.175, 2.175, 2.175, 2.61, 2.61, 2.61])  # [rad/s]
TORQUE_LIMIT = np.array([87.0, 87.0, 87.0, 87.0, 12.0, 12.0, 12.0])  # [N m]
HOME = np.array([0.0, -0.7853981634, 0.0, -2.3561944902, 0.0, 1.5707963268, 0.7853981634])  # [rad]

FINGER_OPENING = 0.04  # [m], each finger from the middle
FINGER_HEIGHT = 0.0584  # [m], finger frames above the hand frame
