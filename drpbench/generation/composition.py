"""What drpbench-v1 is made of: tasks, and in each the scene families, pairs of poses and levels."""

from __future__ import annotations

from dataclasses import dataclass

PAIRS = ("ff", "ft", "tf", "tt")
"""Start and goal, each free (the hand in the open) or tight (inside or close to the furniture)."""

_FURNISHED = (
    "box",
    "cage",
    "cubby",
    "dishwasher",
    "hybrid",
    "microwave",
    "shelf",
    "wall_cabinet",
)


@dataclass(frozen=True)
class Group:
    """`count` problems of one kind. `distance` [m] is the least way from start to goal position."""

    family: str
    pair: str
    level: int
    count: int
    distance: float

    @property
    def stays(self) -> bool:
        """Whether the goal is the start: there is no way to go."""
        return self.distance == 0.0


COMPOSITION: dict[str, tuple[Group, ...]] = {
    "SE": tuple(
        Group(family, pair, 0, 100, 0.2 if pair == "tt" else 0.3)
        for pair in PAIRS
        for family in _FURNISHED
    ),
    "SAO": (
        Group("table", "ff", 1, 100, 0.5),
        Group("box", "ff", 2, 100, 0.5),
        Group("hybrid", "ff", 3, 100, 0.5),
    ),
    "FDO": (Group("table", "ff", 1, 100, 0.4), Group("box", "ff", 2, 100, 0.4)),
    "GB": (Group("table", "ff", 1, 100, 0.5), Group("box", "ff", 2, 100, 0.5)),
    # The arm starts at the goal and has to come back to it: no way to go, so no distance.
    "DGB": (
        Group("table", "ff", 1, 100, 0.0),
        Group("table", "ff", 2, 100, 0.0),
        Group("box", "ff", 3, 100, 0.0),
        Group("shelf", "tt", 4, 100, 0.0),
    ),
}


def group_of(task: str, index: int) -> Group:
    """The group of a task's problem number `index`. Groups take turns, so any prefix is a
    sample."""
    groups = COMPOSITION[task]
    return groups[index % len(groups)]


def size_of(task: str) -> int:
    """Number of problems of a task."""
    return sum(group.count for group in COMPOSITION[task])
