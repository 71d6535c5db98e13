"""A dishwasher with its door down and the lower rack, with plates and cups, pulled out."""

from __future__ import annotations

import numpy as np

from drpbench.generation import scene
from drpbench.generation.families import placement


def build(rng: np.random.Generator, items: int = 8) -> scene.Furniture:
    """The machine (smaller than a kitchen's, as it shares the arm's table), door down to the
    front."""
    width, depth, height = rng.uniform(0.46, 0.56), rng.uniform(0.36, 0.44), rng.uniform(0.46, 0.58)
    wall, half = rng.uniform(0.015, 0.025), width / 2
    parts = [
        scene.span((0, -half, 0), (depth, half, 0.05)),
        scene.span((0, -half, height - wall), (depth, half, height)),
        scene.span((0, half - wall, 0.05), (depth, half, height - wall)),
        scene.span((0, -half, 0.05), (depth, -half + wall, height - wall)),
        scene.span((depth - wall, -half + wall, 0.05), (depth, half - wall, height - wall)),
    ]
    door = min(height - 0.06, 0.42)
    parts.append(scene.span((-door, -half, 0.02), (0, half, 0.045)))
    # Lower rack: a tray with two rails, run out over the door by `out`.
    out, tray = rng.uniform(0.20, 0.28), depth - 0.08
    edge, base = half - wall - 0.02, 0.065
    parts.append(scene.span((-out, -edge, base), (tray - out, edge, base + 0.008)))
    for y in (-edge, edge):
        parts.append(scene.bar(0.006, (-out, y, base + 0.09), (tray - out, y, base + 0.09)))
    parts.append(scene.bar(0.006, (-out, -edge, base + 0.09), (-out, edge, base + 0.09)))
    # Upper rack, pushed in.
    upper = rng.uniform(0.56, 0.62) * height
    parts.append(scene.span((0.03, -edge, upper), (depth - wall - 0.02, edge, upper + 0.01)))
    dishes = max(items // 2, 2)
    plates = int(rng.integers(min(3, dishes), dishes + 1))
    radius = rng.uniform(0.075, 0.095)
    side = 1 if rng.uniform() < 0.5 else -1
    xs = np.linspace(-out + 0.05, tray - out - 0.08, plates)
    row = side * edge * 0.5
    for x in xs:
        centre = (x, row, base + 0.012 + radius)
        parts.append(scene.cylinder(radius, 0.012, centre, scene.AXIS_X))
    for index in range(items - dishes):
        x = -out + 0.06 + 0.09 * index
        y = -side * edge * rng.uniform(0.6, 0.75)
        tall = rng.uniform(0.08, 0.12)
        parts.append(
            scene.cylinder(rng.uniform(0.03, 0.038), tall, (x, y, base + 0.008 + tall / 2))
        )
    rim = base + 0.012 + 2 * radius
    grasp = scene.region(
        "at the plates",
        (-out + 0.04, row - 0.05, rim - 0.03),
        (-0.06, row + 0.05, rim + 0.04),
        (0.25, 0, -1),
        wide=(1.0, 0.0, 0.0),
        tilt=0.3,
        roll=0.5,
    )
    gap = scene.region(
        "beside the plates",
        (-out + 0.06, -side * 0.35 * edge - 0.03, base + 0.06),
        (-0.06, -side * 0.35 * edge + 0.03, base + 0.14),
        (0.25, 0, -1),
        wide=(1.0, 0.0, 0.0),
        tilt=0.3,
        roll=0.4,
    )
    inside = scene.region(
        "over the upper rack",
        (0.02, -0.5 * edge, upper + 0.06),
        (0.55 * depth, 0.5 * edge, height - wall - 0.05),
        (1, 0, 0),
        wide=placement.ACROSS,
        tilt=0.25,
        roll=0.4,
    )
    return scene.Furniture(
        tuple(parts), (grasp, gap, inside, inside), np.array([depth, width, height])
    )


def draw(rng: np.random.Generator) -> scene.Scene:
    """One dishwasher before the arm."""
    piece = build(rng)
    position, yaw = placement.pose(rng, (0.52, 0.60), (-0.8, 0.8), swivel=0.1)
    return scene.compose(
        "dishwasher", (piece.placed(position, yaw),), placement.around(piece.size, position, yaw)
    )
