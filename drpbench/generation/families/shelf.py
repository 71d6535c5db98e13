"""A shelf: boards between two sides, with books, bottles and balls on them."""

from __future__ import annotations

import numpy as np

from drpbench.generation import scene
from drpbench.generation.families import placement

FORWARD = np.array([1.0, 0.0, 0.0])


def build(rng: np.random.Generator, items: int = 9, compact: bool = False) -> scene.Furniture:
    """Two or three levels of boards with up to `items` objects; each level keeps a gap for a
    hand."""
    boards = 3 if compact else int(rng.integers(3, 5))
    width = rng.uniform(0.45, 0.55) if compact else rng.uniform(0.65, 0.95)
    gap = rng.uniform(0.26, 0.34) if boards == 3 else rng.uniform(0.23, 0.28)
    depth, board = rng.uniform(0.22, 0.32), rng.uniform(0.015, 0.025)
    foot = rng.uniform(0.02, 0.08)
    half, height = width / 2, foot + (boards - 1) * gap + board
    levels = foot + gap * np.arange(boards)
    parts = [scene.span((0, -half, z), (depth, half, z + board)) for z in levels]
    parts += [
        scene.span((0, half, 0), (depth, half + board, height)),
        scene.span((0, -half - board, 0), (depth, -half, height)),
    ]
    if rng.uniform() < 0.5:
        parts.append(scene.span((depth, -half, 0), (depth + 0.008, half, height)))
    tight, objects = [], []
    for level, z in enumerate(levels[:-1]):
        floor, room = z + board, gap - board
        places = placement.slots(rng, -half + 0.02, half - 0.02, 3 if compact else 5)
        hands = set(rng.choice(len(places), 1 if compact else 2, replace=False).tolist())
        for index, (y, share) in enumerate(places):
            if index in hands:
                tight.append(
                    scene.region(
                        f"level {level}",
                        (-0.02, y - 0.04, floor + 0.3 * room),
                        (0.6 * depth, y + 0.04, floor + 0.7 * room),
                        FORWARD,
                        wide=placement.ACROSS,
                        tilt=0.3,
                        roll=np.pi,
                    )
                )
            else:
                objects.append(things(rng, depth, y, floor, share, room))
    keep = rng.permutation(len(objects))[:items]
    parts += [objects[i] for i in sorted(keep)]
    return scene.Furniture(tuple(parts), tuple(tight), np.array([depth, width + 2 * board, height]))


def things(
    rng: np.random.Generator, depth: float, y: float, floor: float, share: float, room: float
) -> scene.Primitive:
    """What stands in one place on a board: a block of upright books, or a single object."""
    if rng.uniform() < 0.4:
        tall, thick = rng.uniform(0.55, 0.8) * room, rng.uniform(0.5, 0.95) * share
        deep = rng.uniform(0.55, 0.75) * depth
        return scene.box((deep, thick, tall), (depth - deep / 2 - 0.01, y, floor + tall / 2))
    x = rng.uniform(0.4, 0.65) * depth
    return placement.item(rng, x, y, floor, min(0.85 * share, 0.13), 0.75 * room)


def draw(rng: np.random.Generator) -> scene.Scene:
    """One shelf before the arm."""
    piece = build(rng)
    position, yaw = placement.pose(rng, (0.42, 0.58), (-0.7, 0.7))
    return scene.compose(
        "shelf", (piece.placed(position, yaw),), placement.around(piece.size, position, yaw)
    )
