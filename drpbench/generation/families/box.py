"""Open-topped boxes on the table: one or two bins, or a carton with its flaps open."""

from __future__ import annotations

import numpy as np

from drpbench.generation import scene
from drpbench.generation.families import placement
from drpbench.geometry import host_rotation as rotation

DOWN = np.array([0.0, 0.0, -1.0])


def build(rng: np.random.Generator, items: int = 3, compact: bool = False) -> scene.Furniture:
    """A bin, or a carton with four flaps, with up to `items` objects in it."""
    depth = rng.uniform(0.30, 0.36 if compact else 0.42)
    width = rng.uniform(0.32, 0.38 if compact else 0.50)
    height = rng.uniform(0.18, 0.30 if compact else 0.38)
    wall = rng.uniform(0.008, 0.02)
    half = width / 2
    parts = [
        scene.span((0, -half, 0), (depth, half, wall)),
        scene.span((0, -half, wall), (wall, half, height)),
        scene.span((depth - wall, -half, wall), (depth, half, height)),
        scene.span((wall, half - wall, wall), (depth - wall, half, height)),
        scene.span((wall, -half, wall), (depth - wall, -half + wall, height)),
    ]
    flapped = not compact and rng.uniform() < 0.4
    if flapped:
        parts += flaps(rng, depth, width, height)
    filled = 0.0
    places = placement.slots(rng, -half + wall, half - wall, items)
    for y, room in places[: rng.integers(items + 1)]:
        x = rng.uniform(0.35, 0.65) * depth
        parts.append(placement.item(rng, x, y, wall, min(0.8 * room, 0.10), 0.35 * height))
        filled = 0.35 * height
    inside = scene.region(
        "in the box",
        (0.3 * depth, -0.35 * width, wall + filled + 0.02),
        (0.7 * depth, 0.35 * width, max(height - 0.03, wall + filled + 0.05)),
        approach=DOWN,
        wide=placement.ACROSS,
        tilt=0.35,
        roll=np.pi if not compact else 0.6,
    )
    size = np.array([depth, width, height])
    beside = () if flapped else placement.close_beside(size)
    return scene.Furniture(tuple(parts), (inside, inside, *beside), size)


def flaps(
    rng: np.random.Generator, depth: float, width: float, height: float
) -> list[scene.Primitive]:
    """Four flaps hinged on the upper rim, leaning outward by 20 to 60 degrees from upright."""
    length, thickness = rng.uniform(0.10, 0.15), 0.006
    parts = []
    # Hinge, outward direction, and extent along the rim of each flap.
    sides = (
        ((0.0, 0.0), (-1.0, 0.0), width),
        ((depth, 0.0), (1.0, 0.0), width),
        ((depth / 2, width / 2), (0.0, 1.0), depth),
        ((depth / 2, -width / 2), (0.0, -1.0), depth),
    )
    for (x, y), (ox, oy), along in sides:
        lean = rng.uniform(0.35, 1.05)
        yaw = np.arctan2(oy, ox)
        turn = rotation.multiply(
            rotation.axis_angle((0, 0, 1), yaw), rotation.axis_angle((0, 1, 0), lean)
        )
        out, up = np.sin(lean) * length / 2, np.cos(lean) * length / 2
        centre = (x + ox * out, y + oy * out, height + up)
        parts.append(scene.box((thickness, along, length), centre, turn))
    return parts


def draw(rng: np.random.Generator) -> scene.Scene:
    """One large box before the arm, or two smaller ones side by side."""
    if rng.uniform() < 0.5:
        piece = build(rng)
        position, yaw = placement.pose(rng, (0.33, 0.45), (-0.6, 0.6), swivel=0.4)
        return scene.compose(
            "box", (piece.placed(position, yaw),), placement.around(piece.size, position, yaw)
        )
    placed: list[scene.Furniture] = []
    free: list[scene.HandRegion] = []
    middle = rng.uniform(-0.25, 0.25)
    for side in (1, -1):
        piece = build(rng, compact=True)
        position, yaw = placement.pose(
            rng, (0.34, 0.44), (middle + side * 0.55, middle + side * 0.75), swivel=0.1
        )
        placed.append(piece.placed(position, yaw))
        free += placement.around(piece.size, position, yaw)
    return scene.compose("box", tuple(placed), tuple(free))
