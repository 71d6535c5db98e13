"""A cubby: a case parted into a grid of compartments that are open to the front."""

from __future__ import annotations

import numpy as np

from drpbench.generation import scene
from drpbench.generation.families import placement

FORWARD = np.array([1.0, 0.0, 0.0])


def build(rng: np.random.Generator, items: int = 5, compact: bool = False) -> scene.Furniture:
    """Rows of compartments with a divider pattern of their own, and up to `items` objects."""
    rows, columns = (2, 2) if compact else (int(rng.integers(2, 4)), int(rng.integers(2, 4)))
    width = columns * rng.uniform(0.24, 0.27 if compact else 0.32)
    height = rows * rng.uniform(0.22, 0.28)
    depth, board = rng.uniform(0.24, 0.34), rng.uniform(0.01, 0.02)
    half = width / 2
    levels = np.linspace(board / 2, height - board / 2, rows + 1)
    parts = [scene.span((0, -half, z - board / 2), (depth, half, z + board / 2)) for z in levels]
    parts += [
        scene.span((0, y - board / 2, 0), (depth, y + board / 2, height)) for y in (-half, half)
    ]
    parts.append(scene.span((depth, -half, 0), (depth + board, half, height)))
    tight, objects = [], []
    for row, (z0, z1) in enumerate(zip(levels[:-1], levels[1:], strict=True)):
        floor, ceiling = z0 + board / 2, z1 - board / 2
        cells = placement.slots(rng, -half, half, columns)
        for column, (y, room) in enumerate(cells):
            if column:
                edge = y - room / 2
                parts.append(
                    scene.span((0, edge - board / 2, floor), (depth, edge + board / 2, ceiling))
                )
            if rng.uniform() < 0.35:
                objects.append(
                    placement.item(
                        rng,
                        rng.uniform(0.55, 0.75) * depth,
                        y + rng.uniform(-0.15, 0.15) * room,
                        floor,
                        min(0.4 * room, 0.10),
                        0.6 * (ceiling - floor),
                    )
                )
            tight.append(
                scene.region(
                    f"compartment {row},{column}",
                    (-0.02, y - 0.15 * room, floor + 0.35 * (ceiling - floor)),
                    (0.55 * depth, y + 0.15 * room, floor + 0.65 * (ceiling - floor)),
                    FORWARD,
                    wide=placement.ACROSS,
                    tilt=0.3,
                    roll=np.pi,
                )
            )
    parts += objects[:items]
    return scene.Furniture(tuple(parts), tuple(tight), np.array([depth, width, height]))


def draw(rng: np.random.Generator) -> scene.Scene:
    """One cubby before the arm, on the table or on a low stand's height."""
    piece = build(rng)
    position, yaw = placement.pose(rng, (0.42, 0.58), (-0.7, 0.7))
    return scene.compose(
        "cubby", (piece.placed(position, yaw),), placement.around(piece.size, position, yaw)
    )
