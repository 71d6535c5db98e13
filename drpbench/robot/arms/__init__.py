"""Arms, each in a folder of its own."""

from collections.abc import Callable

from drpbench.robot.robot import Robot

from .panda import panda

ARMS: dict[str, Callable[..., Robot]] = {"panda": panda}
"""By the names that problem sets and results give."""

PANDA = panda()
