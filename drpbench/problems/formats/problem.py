"""One problem as another project's file has it, and how its numbers are read."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from drpbench.errors import DrpbenchError
from drpbench.geometry import MAX_OBSTACLES

_FAR = 100.0  # [m]: what is farther away or larger is no obstacle of an arm's


class FormatError(DrpbenchError):
    """A file that is not of its format; the message is one line that names it."""


@dataclass(frozen=True)
class OtherProblem:
    """A problem of the task SE: joints [rad], obstacles as lines of a set's file have them."""

    where: str
    """The file, and the place in it."""
    family: str
    start: Sequence[float]
    goals: Sequence[Sequence[float]]
    """One, or several for one pose of the hand."""
    obstacles: Sequence[Mapping[str, Any]]
    finger_opening: float
    """[m] of each finger from the middle."""
    infeasible: bool = False
    """Whether its own set says that it has no solution."""


def field(values: Any, name: str, where: str) -> Any:
    """The value of a mapping's field. Raises FormatError."""
    if not isinstance(values, Mapping):
        raise FormatError(f"{where}: expected fields, among them {name}")
    if name not in values:
        raise FormatError(f"{where}: there is no {name}")
    return values[name]


def items(values: Any, where: str) -> Sequence[Any]:
    """A list. Raises FormatError."""
    if not isinstance(values, list):
        raise FormatError(f"{where}: expected a list")
    return values


def numbers(values: Any, count: int, where: str) -> list[float]:
    """A list of so many finite numbers. Raises FormatError."""
    if not isinstance(values, list) or len(values) != count:
        raise FormatError(f"{where}: expected {count} numbers")
    for value in values:
        if isinstance(value, bool) or not isinstance(value, int | float) or not _finite(value):
            raise FormatError(f"{where}: expected {count} finite numbers")
    return [float(value) for value in values]


def _finite(value: int | float) -> bool:
    try:
        return math.isfinite(value)
    except OverflowError:  # an integer with hundreds of digits
        return False


def obstacle(
    shape: str,
    size: Mapping[str, Any],
    position: Sequence[float],
    quaternion: Sequence[float],
    where: str,
) -> dict[str, Any]:
    """An obstacle as a line of a set's file has it; `quaternion` is wxyz, of any length but 0.

    Raises FormatError for a size that is none.
    """
    length = math.hypot(*quaternion)
    if not 0.5 < length < 2.0:
        raise FormatError(f"{where}: expected a unit quaternion, got one of length {length:g}")
    sizes = [
        one for value in size.values() for one in (value if isinstance(value, list) else [value])
    ]
    if not all(0.0 < one < _FAR for one in sizes):
        raise FormatError(f"{where}: expected sizes above 0 and below {_FAR:g} m, got {sizes}")
    if not all(abs(one) < _FAR for one in position):
        raise FormatError(f"{where}: expected a place within {_FAR:g} m, got {list(position)}")
    turn = [one / length for one in quaternion]
    return {"shape": shape, **size, "position": list(position), "quaternion": turn}


def require_room(obstacles: Sequence[Any], where: str) -> None:
    """Raises FormatError for more obstacles than a scene has room for."""
    if len(obstacles) > MAX_OBSTACLES:
        raise FormatError(
            f"{where}: {len(obstacles)} obstacles; a scene has room for {MAX_OBSTACLES}"
        )
