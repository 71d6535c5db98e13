"""Scenes of no family: one to three parametric assets anywhere about the arm, and clutter.

The families are eight kinds of furniture on a table in front of the arm. Here assets of random
measures (racks, bins, cages, tables to reach under, boards with a window, corridors, things to
grasp) stand on any side, at any height, below the base too, on a table, on a low floor or in
the air. Openings take any size, boards are 5 to 40 mm thick. In the spirit of Neural MP's scenes
(Dalal et al., 2024).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from drpbench.geometry import MAX_OBSTACLES
from drpbench.geometry import host_rotation as rotation

from . import scene
from .scene import Furniture, HandRegion, Primitive, Scene

NAME = "assembly"
_Rng = np.random.Generator
_ANY = (0.0, 0.0, 1.0)
_INTO = (1.0, 0.0, 0.0)
_DOWN = (0.0, 0.0, -1.0)


def _board(rng: _Rng) -> float:
    """Thickness [m]."""
    return float(rng.uniform(0.005, 0.04))


def _furniture(parts: list[Primitive], tight: list[HandRegion], size: tuple) -> Furniture:
    return Furniture(tuple(parts), tuple(tight), np.array(size, float))


def rack(rng: _Rng) -> Furniture:
    """Cells open to the front, in columns and rows, with or without a back, sides and a top."""
    columns, rows = int(rng.integers(1, 4)), int(rng.integers(1, 4))
    depth, t = rng.uniform(0.15, 0.5), _board(rng)
    widths, heights = rng.uniform(0.14, 0.5, columns), rng.uniform(0.12, 0.5, rows)
    if rng.uniform() < 0.4:  # pigeonholes of little more than the hand, lying or upright
        hand = (rng.uniform(0.22, 0.32, columns), rng.uniform(0.08, 0.15, rows))
        lying = rng.uniform() < 0.6
        widths, heights = hand if lying else (hand[1][:1].repeat(columns), hand[0][:1].repeat(rows))
    y = np.concatenate([[0.0], np.cumsum(widths + t)])
    z = rng.uniform(0, 0.3) * (rng.uniform() < 0.5) + np.concatenate(
        [[0.0], np.cumsum(heights + t)]
    )
    y -= y[-1] / 2
    sides, top = rng.uniform() < 0.8, rng.uniform() < 0.8
    parts = [
        scene.span((0, y[i] - t, z[0] - t), (depth, y[i], z[-1]))
        for i in range(columns + 1)
        if sides or 0 < i < columns
    ]
    parts += [
        scene.span((0, y[0] - t, z[k] - t), (depth, y[-1], z[k]))
        for k in range(rows + 1)
        if top or k < rows
    ]
    if rng.uniform() < 0.6:
        parts.append(scene.span((depth, y[0] - t, z[0] - t), (depth + t, y[-1], z[-1])))
    tight = [
        scene.region(
            "in the rack",
            (rng.uniform(-0.02, 0.5) * depth, y[i] + 0.03, z[k] + 0.03),
            (0.9 * depth, y[i + 1] - t - 0.03, z[k + 1] - t - 0.03),
            _INTO,
            wide=(0, 1, 0),
            tilt=0.5,
            roll=np.pi,
        )
        for i in range(columns)
        for k in range(rows)
    ]
    return _furniture(parts, tight, (depth, y[-1] - y[0], z[-1]))


def bin(rng: _Rng) -> Furniture:
    """A box open at its top."""
    depth, width, height = rng.uniform(0.18, 0.6), rng.uniform(0.18, 0.6), rng.uniform(0.08, 0.5)
    t, half = _board(rng), width / 2
    parts = [
        scene.span((0, -half, 0), (depth, half, t)),
        scene.span((0, -half, 0), (t, half, height)),
        scene.span((depth - t, -half, 0), (depth, half, height)),
        scene.span((0, -half, 0), (depth, -half + t, height)),
        scene.span((0, half - t, 0), (depth, half, height)),
    ]
    inside = scene.region(
        "in the bin",
        (0.2 * depth, -0.6 * half, t + 0.04),
        (0.8 * depth, 0.6 * half, height + 0.02),
        _DOWN,
        wide=(0, 1, 0),
        tilt=0.5,
        roll=np.pi,
    )
    return _furniture(parts, [inside], (depth, width, height))


def cage(rng: _Rng) -> Furniture:
    """Bars along the edges and some sides of a box, open at one side."""
    depth, width, height = rng.uniform(0.25, 0.5), rng.uniform(0.3, 0.6), rng.uniform(0.3, 0.6)
    half, r = width / 2, rng.uniform(0.005, 0.02)
    ring = [(0, -half), (0, half), (depth, half), (depth, -half)]
    parts = [scene.bar(r, (*p, 0), (*p, height)) for p in ring]
    parts += [
        scene.bar(r, (*a, height), (*b, height))
        for a, b in zip(ring, ring[1:] + ring[:1], strict=True)
    ]
    opens_up = rng.uniform() < 0.4
    thin = rng.uniform(0.6, 1.0) * r
    for x in rng.uniform(0.15, 0.85, int(rng.integers(0, 3))) * depth:
        parts += [scene.bar(thin, (x, s * half, 0), (x, s * half, height)) for s in (-1, 1)]
        if not opens_up:
            parts.append(scene.bar(thin, (x, -half, height), (x, half, height)))
    parts += [
        scene.bar(thin, (depth, y, 0), (depth, y, height))
        for y in rng.uniform(-0.8, 0.8, int(rng.integers(0, 4))) * half
    ]
    if rng.uniform() < 0.6:
        parts.append(scene.span((0, -half, -_board(rng)), (depth, half, 0)))
    inside = scene.region(
        "in the cage",
        (0.0, -0.7 * half, 0.05),
        (0.85 * depth, 0.7 * half, 0.85 * height),
        _DOWN if opens_up else _INTO,
        wide=(0, 1, 0),
        tilt=0.6,
        roll=np.pi,
    )
    return _furniture(parts, [inside], (depth, width, height))


def counter(rng: _Rng) -> Furniture:
    """A slab on legs or on nothing, with things on it: to reach over, onto and under."""
    depth, width, t = rng.uniform(0.3, 0.9), rng.uniform(0.4, 1.4), _board(rng)
    high, half = rng.uniform(0.15, 0.7), width / 2
    parts = [scene.span((0, -half, high - t), (depth, half, high))]
    if rng.uniform() < 0.5:
        leg = rng.uniform(0.01, 0.04)
        parts += [
            scene.bar(leg, (x, y, 0), (x, y, high - t))
            for x in (leg, depth - leg)
            for y in (leg - half, half - leg)
        ]
    tight = [
        scene.region(
            "just above",
            (0.0, -0.9 * half, high + 0.02),
            (0.7 * depth, 0.9 * half, high + 0.10),
            _DOWN,
            wide=(0, 1, 0),
            tilt=0.8,
            roll=np.pi,
        ),
        scene.region(
            "beneath",
            (-0.02, -0.9 * half, high - t - 0.3),
            (0.6 * depth, 0.9 * half, high - t - 0.06),
            _INTO,
            wide=(0, 1, 0),
            tilt=0.7,
            roll=np.pi,
        ),
    ]
    for _ in range(int(rng.integers(0, 4))):
        x, y = rng.uniform(0.1, 0.9) * depth, rng.uniform(-0.9, 0.9) * half
        thing, grasp = _thing(rng, (x, y, high))
        parts.append(thing)
        tight += grasp
    return _furniture(parts, tight, (depth, width, high))


def board(rng: _Rng) -> Furniture:
    """An upright board, whole or with a window to reach through."""
    width, height, t = rng.uniform(0.3, 1.2), rng.uniform(0.3, 1.0), _board(rng)
    half = width / 2
    if rng.uniform() < 0.4:
        close = scene.region(
            "close to the board",
            (-0.12, -0.9 * half, 0.05),
            (-0.05, 0.9 * half, height),
            _ANY,
            wide=(0, 1, 0),
            tilt=np.pi,
            roll=np.pi,
        )
        return _furniture(
            [scene.span((0, -half, 0), (t, half, height))], [close], (t, width, height)
        )
    across, tall = rng.uniform(0.2, 0.5), rng.uniform(0.2, 0.5)
    low = rng.uniform(0.0, 0.4)
    left, right = -across / 2, across / 2
    parts = [
        scene.span((0, left - half, 0), (t, left, low + tall + 0.2)),
        scene.span((0, right, 0), (t, right + half, low + tall + 0.2)),
        scene.span((0, left, low + tall), (t, right, low + tall + 0.2)),
    ]
    if low > 0.02:
        parts.append(scene.span((0, left, 0), (t, right, low)))
    through = scene.region(
        "through the window",
        (-0.02, left + 0.04, low + 0.04),
        (0.25, right - 0.04, low + tall - 0.04),
        _INTO,
        wide=(0, 1, 0),
        tilt=0.5,
        roll=np.pi,
    )
    return _furniture(parts, [through], (t, 2 * half + across, low + tall + 0.2))


def corridor(rng: _Rng) -> Furniture:
    """Two boards with a gap, upright or lying."""
    depth, gap, t = rng.uniform(0.2, 0.6), rng.uniform(0.1, 0.35), _board(rng)
    width, height = rng.uniform(0.3, 0.8), rng.uniform(0.25, 0.8)
    if rng.uniform() < 0.5:  # upright
        parts = [
            scene.span(
                (0, s * (gap / 2) - (t if s < 0 else 0), 0),
                (depth, s * gap / 2 + (t if s > 0 else 0), height),
            )
            for s in (-1, 1)
        ]
        low, high = (0.0, -gap / 2 + 0.04, 0.05), (0.9 * depth, gap / 2 - 0.04, height)
    else:
        bottom = rng.uniform(0.0, 0.4)
        parts = [
            scene.span((0, -width / 2, bottom - t), (depth, width / 2, bottom)),
            scene.span((0, -width / 2, bottom + gap), (depth, width / 2, bottom + gap + t)),
        ]
        low, high = (
            (0.0, -0.4 * width, bottom + 0.04),
            (0.9 * depth, 0.4 * width, bottom + gap - 0.04),
        )
        height = bottom + gap
    between = scene.region("between boards", low, high, _INTO, (0, 1, 0), tilt=0.6, roll=np.pi)
    return _furniture(parts, [between], (depth, gap, height))


def _thing(rng: _Rng, foot: tuple[float, float, float]) -> tuple[Primitive, list[HandRegion]]:
    """A small object standing at `foot`, and grasps of it: it is between the open fingers."""
    half, tall = rng.uniform(0.008, 0.028), rng.uniform(0.05, 0.25)
    x, y, z = foot
    if rng.uniform() < 0.5:
        thing = scene.cylinder(half, tall, (x, y, z + tall / 2))
    else:
        turn = rotation.axis_angle((0, 0, 1), rng.uniform(-np.pi, np.pi))
        thing = scene.box((2 * half, 2 * half, tall), (x, y, z + tall / 2), turn)
    from_above = scene.region(
        "about an object",
        (x - 0.004, y - 0.004, z + max(0.03, tall - 0.05)),
        (x + 0.004, y + 0.004, z + tall),
        _DOWN,
        wide=(0, 1, 0),
        tilt=0.3,
        roll=np.pi,
    )
    from_before = scene.region(
        "about an object",
        (x - 0.004, y - 0.004, z + 0.5 * tall),
        (x + 0.004, y + 0.004, z + 0.9 * tall),
        _INTO,
        wide=(0, 1, 0),
        tilt=0.3,
        roll=0.2,
    )
    return thing, [from_above, from_above, from_before]


def stand(rng: _Rng) -> Furniture:
    """A small table with things to grasp."""
    depth, width, t = rng.uniform(0.15, 0.5), rng.uniform(0.2, 0.8), _board(rng)
    high = rng.uniform(t, 0.5)
    parts = [scene.span((0, -width / 2, high - t), (depth, width / 2, high))]
    tight: list[HandRegion] = []
    for _ in range(int(rng.integers(1, 5))):
        x, y = rng.uniform(0.05, 0.95) * depth, rng.uniform(-0.45, 0.45) * width
        thing, grasps = _thing(rng, (x, y, high))
        parts.append(thing)
        tight += grasps
    return _furniture(parts, tight, (depth, width, high))


ASSETS: dict[str, Callable[[_Rng], Furniture]] = {
    "rack": rack,
    "bin": bin,
    "cage": cage,
    "counter": counter,
    "board": board,
    "corridor": corridor,
    "stand": stand,
}


def _clutter(rng: _Rng, count: int) -> list[Primitive]:
    """Objects of all shapes in the air about the arm."""
    found = []
    for _ in range(count):
        bearing, away = rng.uniform(-np.pi, np.pi), rng.uniform(0.3, 0.9)
        place = (away * np.cos(bearing), away * np.sin(bearing), rng.uniform(-0.4, 1.0))
        turn = rng.normal(size=4)
        turn /= np.linalg.norm(turn)
        size = rng.uniform(0.03, 0.3, 3)
        shape = rng.integers(3)
        if shape == 0:
            found.append(scene.box(size, place, turn))
        elif shape == 1:
            found.append(scene.cylinder(size[0] / 2, 2 * size[1], place, turn))
        else:
            found.append(scene.sphere(size[0] / 2, place))
    return found


def _foundation(rng: _Rng) -> tuple[list[Primitive], float]:
    """What the arm stands on, first what bears it, and how low [m] things may stand about it."""
    kind = rng.uniform()
    if kind < 0.45:
        return [scene.TABLE], 0.0
    half = rng.uniform(0.08, 0.2, 2)
    deep = rng.uniform(0.3, 0.9)
    pedestal = scene.span((-half[0], -half[1], -deep), (half[0], half[1], -0.005))
    if kind < 0.75:
        return [pedestal], -0.5
    return [pedestal, scene.span((-1.5, -1.5, -deep - 0.02), (1.5, 1.5, -deep))], -deep


def draw(rng: np.random.Generator) -> Scene:
    """One scene. Where there are too many obstacles, the last ones are left out."""
    parts, lowest = _foundation(rng)
    tight: list[HandRegion] = []
    for _ in range(int(rng.choice((1, 2, 3), p=(0.5, 0.35, 0.15)))):
        piece = ASSETS[list(ASSETS)[rng.integers(len(ASSETS))]](rng)
        if len(parts) + len(piece.parts) > MAX_OBSTACLES:
            continue
        bearing, away = rng.uniform(-2.6, 2.6), rng.uniform(0.22, 0.6)
        height = lowest if rng.uniform() < 0.4 else rng.uniform(lowest, 0.5)
        if lowest < 0.0 and rng.uniform() < 0.5:
            height = rng.uniform(-0.4, 0.1)
        swivel = rng.uniform(-0.6, 0.6) if rng.uniform() < 0.8 else rng.uniform(-np.pi, np.pi)
        place = (away * np.cos(bearing), away * np.sin(bearing), height)
        placed = piece.placed(place, bearing + swivel)
        parts += placed.parts
        tight += placed.tight
    parts += _clutter(rng, int(rng.integers(0, 7)))
    parts = parts[:MAX_OBSTACLES]
    free = []
    for _ in range(4):
        bearing, away = rng.uniform(-2.5, 2.5), rng.uniform(0.3, 0.65)
        centre = np.array([away * np.cos(bearing), away * np.sin(bearing), rng.uniform(-0.2, 0.8)])
        ahead = (np.cos(bearing), np.sin(bearing), rng.uniform(-1.5, 0.3))
        free.append(
            scene.region("in the open", centre - 0.1, centre + 0.1, ahead, _ANY, np.pi / 3, np.pi)
        )
    home = np.array([0.31, 0.0, 0.49])
    free.append(
        scene.region("at home", home - 0.1, home + 0.1, _DOWN, (0, 1, 0), tilt=0.4, roll=np.pi)
    )
    return Scene(NAME, scene.obstacles_of(parts), tuple(tight) or tuple(free), tuple(free))
