"""Problems in the ranges that Motion Policy Networks publishes for its own (Fishman et al., 2022).

The families are its four: a table with things on it, a cubby of two by two, one whose cells are
partly merged, and a dresser with drawers pulled out. So are the numbers of each, and their kinds:
from the neutral posture into the furniture, out of it, and from one place in it to another. The
problems are ours: what MPiNets' own files hold is not imitated. Where a range is not published, the
code says what was chosen.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from drpbench.geometry import host_rotation as rotation

from .composition import Group
from .scene import (
    Furniture,
    HandRegion,
    Primitive,
    Scene,
    box,
    cylinder,
    obstacles_of,
    region,
    span,
)

NAME = "mpinets-like-v1"
_EACH = 75
_KINDS = ("ft", "tf", "tt", "tt")  # the neutral posture is free; as many inside as out and in
_FORWARD, _DOWN, _ACROSS = (1.0, 0.0, 0.0), (0.0, 0.0, -1.0), (0.0, 1.0, 0.0)

# There is no ground: the arm stands on a column.
_COLUMN = span((-0.09, -0.09, -0.42), (0.09, 0.09, -0.02))
_NEUTRAL = region(
    "neutral", (0.23, -0.12, 0.4), (0.39, 0.12, 0.6), _DOWN, wide=_ACROSS, tilt=0.25, roll=0.5
)


def _scene(family: str, parts: list[Primitive], tight: list[HandRegion]) -> Scene:
    return Scene(family, obstacles_of([_COLUMN, *parts]), tuple(tight), (_NEUTRAL,))


def _tabletop(rng: np.random.Generator) -> Scene:
    """A table before the arm, in half of the scenes one beside it too, with three to fifteen things
    (numbers and the table's width are chosen)."""
    top = rng.uniform(0.0, 0.4) if rng.uniform() < 0.65 else 0.0
    front, back = rng.uniform(0.275, 0.375), rng.uniform(1.275, 1.375)
    half, thick = rng.uniform(0.5, 1.0), rng.uniform(0.02, 0.06)
    parts = [span((front, -half, top - thick), (back, half, top))]
    if rng.uniform() < 0.5:
        side, inner = rng.choice((-1, 1)), rng.uniform(0.35, 0.45)
        low, high = sorted((side * inner, side * (inner + rng.uniform(0.3, 0.6))))
        parts.append(span((-0.4, low, top - thick), (front, high, top)))
    tight = []
    for _ in range(int(rng.integers(3, 16))):
        x, y = rng.uniform(front + 0.08, 0.95), rng.uniform(-1, 1) * min(half - 0.08, 0.7)
        width, deep, tall = *rng.uniform(0.03, 0.15, 2), rng.uniform(0.05, 0.35)
        turn = rotation.axis_angle((0, 0, 1), rng.uniform(0, np.pi))
        if rng.uniform() < 0.3:
            parts.append(cylinder(width / 2, tall, (x, y, top + tall / 2)))
        else:
            parts.append(box((width, deep, tall), (x, y, top + tall / 2), turn))
    for _ in range(6):
        x, y = rng.uniform(front + 0.08, 0.75), rng.uniform(-0.5, 0.5)
        low, high = (x - 0.05, y - 0.05, top + 0.03), (x + 0.05, y + 0.05, top + 0.2)
        tight.append(
            region("over the table", low, high, (0.2, 0, -1), wide=_ACROSS, tilt=0.5, roll=np.pi)
        )
    return _scene("tabletop", parts, tight)


def _cells(rng: np.random.Generator, merged: bool) -> Furniture:
    """Two by two cells, open to the front; `merged`: without one of the walls between them."""
    thick, depth = rng.uniform(0.01, 0.03), rng.uniform(0.15, 0.55)
    left, right = rng.uniform(0.6, 0.8), -rng.uniform(0.6, 0.8)
    bottom, top = rng.uniform(0.1, 0.3), rng.uniform(0.6, 0.8)
    shelf, middle = rng.uniform(0.35, 0.55), rng.uniform(-0.1, 0.1)
    t = thick / 2
    parts = [
        span((depth, right, bottom), (depth + thick, left, top)),
        span((0, right, bottom - t), (depth, left, bottom + t)),
        span((0, right, top - t), (depth, left, top + t)),
        span((0, left - t, bottom), (depth, left + t, top)),
        span((0, right - t, bottom), (depth, right + t, top)),
    ]
    rows, columns = ((bottom, shelf), (shelf, top)), ((right, middle), (middle, left))
    cells = [(y, z) for z in rows for y in columns]
    walls = [(span((0, middle - t, z[0]), (depth, middle + t, z[1])), "y", z) for z in rows]
    walls += [(span((0, y[0], shelf - t), (depth, y[1], shelf + t)), "z", y) for y in columns]
    if merged:
        _, along, of = walls.pop(int(rng.integers(len(walls))))
        if along == "y":
            cells = [cell for cell in cells if cell[1] != of] + [((right, left), of)]
        else:
            cells = [cell for cell in cells if cell[0] != of] + [(of, (bottom, top))]
    parts += [wall for wall, _, _ in walls]
    tight = [
        region(
            "a cell",
            (-0.02, y[0] + 0.1, z[0] + 0.07),
            (0.6 * depth, y[1] - 0.1, z[1] - 0.07),
            _FORWARD,
            wide=_ACROSS,
            tilt=0.4,
            roll=np.pi,
        )
        for y, z in cells
    ]
    return Furniture(tuple(parts), tuple(tight), np.array([depth, left - right, top]))


def _cubby(rng: np.random.Generator, merged: bool = False) -> Scene:
    front, yaw = rng.uniform(0.45, 0.65), rng.uniform(-1, 1) * np.pi / 18
    placed = _cells(rng, merged).placed((front, 0.0, 0.0), yaw)
    name = "merged_cubby" if merged else "cubby"
    return _scene(name, list(placed.parts), list(placed.tight))


def _merged_cubby(rng: np.random.Generator) -> Scene:
    return _cubby(rng, merged=True)


_Cell = tuple[float, float, float, float]  # y from, y to, z from, z to


def _split(rng: np.random.Generator, cell: _Cell, chance: float, level: int) -> list[_Cell]:
    """A dresser's front in cells: the wider side is halved, again and again."""
    y0, y1, z0, z1 = cell
    wide, tall = y1 - y0, z1 - z0
    if level == 3 or max(wide, tall) < 0.4 or rng.uniform() > chance:
        return [cell]
    share = rng.uniform(0.4, 0.6)
    if wide > tall:
        at = y0 + share * wide
        halves = (y0, at, z0, z1), (at, y1, z0, z1)
    else:
        at = z0 + share * tall
        halves = (y0, y1, z0, at), (y0, y1, at, z1)
    return [one for half in halves for one in _split(rng, half, 0.7, level + 1)]


def _dresser(rng: np.random.Generator) -> Scene:
    """A body of closed drawers, of which one or two are pulled out by 12 to 25 cm (chosen)."""
    width, depth, height = rng.uniform((0.8, 0.2, 0.55), (1.2, 0.4, 0.85))
    opened: list[_Cell] = []
    while not opened:  # a dresser of narrow drawers has none for a hand
        cells = _split(rng, (-width / 2, width / 2, 0.0, height), 0.8, 0)
        for index in rng.permutation(len(cells)):
            y0, y1, _, _ = cell = cells[index]
            above = any(y0 < other[1] and other[0] < y1 for other in opened)
            if not above and len(opened) < 2 and y1 - y0 > 0.25:
                opened.append(cell)
    parts, tight, t = [], [], 0.012
    for cell in cells:
        y0, y1, z0, z1 = cell
        if cell not in opened:
            parts.append(span((0, y0, z0), (depth, y1, z1)))
            continue
        pull = rng.uniform(0.12, 0.25)
        rim = z0 + 0.6 * (z1 - z0)
        parts += [
            span((-pull, y0, z0), (0, y1, z0 + t)),
            span((-pull, y0, z0), (-pull + t, y1, rim)),
            span((-pull, y0, z0), (0, y0 + t, rim)),
            span((-pull, y1 - t, z0), (0, y1, rim)),
            span((0, y0, z0), (depth, y1, z1)),  # what is behind is out of reach
        ]
        tight.append(
            region(
                "a drawer",
                (-0.6 * pull, y0 + 0.1, z0 + 0.04),
                (-0.4 * pull, y1 - 0.1, rim),
                _DOWN,
                wide=_ACROSS,
                tilt=0.2,
                roll=0.3,
            )
        )
    body = Furniture(tuple(parts), tuple(tight), np.array([depth, width, height]))
    place = (rng.uniform(0.55, 0.75), rng.uniform(-0.1, 0.1), 0.0)
    placed = body.placed(place, rng.uniform(-1, 1) * np.pi / 3)
    return _scene("dresser", list(placed.parts), list(placed.tight))


FAMILIES: dict[str, Callable[[np.random.Generator], Scene]] = {
    "cubby": _cubby,
    "merged_cubby": _merged_cubby,
    "dresser": _dresser,
    "tabletop": _tabletop,
}
# Twice as many dressers and tables as cubbies, in turns: any prefix is a sample.
_TURNS = ("cubby", "dresser", "tabletop", "merged_cubby", "dresser", "tabletop")
_GROUPS = tuple(Group(family, kind, 0, _EACH, 0.2) for kind in _KINDS for family in _TURNS)


def group_of(task: str, index: int) -> Group:
    """The group of problem number `index` of SE; there is no other task."""
    return _GROUPS[index % len(_GROUPS)]


SIZE = sum(group.count for group in _GROUPS)
"""Number of problems: 300 cubbies, 300 merged ones, 600 dressers and 600 tables."""
