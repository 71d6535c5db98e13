"""Arms, each in a folder of its own."""

from collections.abc import Callable

from drpbench.errors import DrpbenchError
from drpbench.robot.robot import Robot

from .panda import panda

ARMS: dict[str, Callable[..., Robot]] = {"panda": panda}
"""By the names that problem sets and results give."""

PANDA = panda()


def arm(name: str, finger_opening: float | None = None) -> Robot:
    """The arm of that name, each finger `finger_opening` [m] from the middle (None: as far as is
    usual).

    Raises DrpbenchError for a name that there is not.
    """
    if name not in ARMS:
        raise DrpbenchError(f"there is no arm {name!r}; the arms are: {', '.join(ARMS)}")
    return ARMS[name]() if finger_opening is None else ARMS[name](finger_opening)
