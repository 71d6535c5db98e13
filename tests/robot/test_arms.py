"""Arms by name: one value for each opening of the fingers."""

import numpy as np
import pytest

from drpbench.errors import DrpbenchError
from drpbench.robot import ARMS, PANDA, arm
from drpbench.robot.arms.panda.fingers import FINGER_OPENING


def test_the_usual_arm_is_one_value():
    assert arm("panda") is PANDA is arm("panda", FINGER_OPENING)


def test_fingers_open_as_far_as_is_said():
    narrow = arm("panda", 0.01)
    assert narrow is arm("panda", 0.01) and narrow != PANDA

    def width(robot):
        fingers = [link.offset[1] for link in robot.links if "finger" in link.name]
        return np.ptp(fingers)

    assert width(narrow) == pytest.approx(0.02) and width(PANDA) == pytest.approx(0.08)


def test_an_arm_that_is_not_there_is_refused_with_those_that_are():
    with pytest.raises(DrpbenchError, match=f"no arm 'ur5'; the arms are: {', '.join(ARMS)}"):
        arm("ur5")
