"""A cage of round bars on a base plate, open at its front or at its top."""

from __future__ import annotations

import numpy as np

from drpbench.generation import scene
from drpbench.generation.families import placement


def build(rng: np.random.Generator, items: int = 1) -> scene.Furniture:
    """A barred cage with its opening at the front or at the top, and up to one object in it."""
    depth, width = rng.uniform(0.34, 0.44), rng.uniform(0.40, 0.52)
    height = rng.uniform(0.34, 0.52)
    plate, post, thin = 0.02, rng.uniform(0.010, 0.016), rng.uniform(0.005, 0.010)
    half = width / 2 - post
    near, far = post, depth - post
    open_front = rng.uniform() < 0.5
    parts = [scene.span((0, -width / 2, 0), (depth, width / 2, plate))]
    corners = [(near, half), (far, half), (far, -half), (near, -half)]
    parts += [scene.bar(post, (x, y, plate), (x, y, height)) for x, y in corners]
    frame = zip(corners, corners[1:] + corners[:1], strict=True)
    parts += [scene.bar(post, (*a, height), (*b, height)) for a, b in frame]

    def row(a: tuple[float, float], b: tuple[float, float], count: int) -> list[scene.Primitive]:
        """Upright bars at equal distances between two corners."""
        steps = np.linspace(0, 1, count + 2)[1:-1]
        points = [(1 - s) * np.array(a) + s * np.array(b) for s in steps]
        return [scene.bar(thin, (*p, plate), (*p, height)) for p in points]

    parts += row(corners[0], corners[1], 3) + row(corners[1], corners[2], 3)
    parts += row(corners[2], corners[3], 3)
    if open_front:
        beams = np.linspace(-half, half, 5)[1:-1]
        parts += [scene.bar(thin, (near, y, height), (far, y, height)) for y in beams]
        low, high = (0.05, -0.35 * half, 0.12), (0.6 * depth, 0.35 * half, height - 0.10)
        approach = (1, 0, 0)
    else:
        parts += row(corners[3], corners[0], 3)
        low, high = (0.3 * depth, -0.4 * half, 0.10), (0.7 * depth, 0.4 * half, height - 0.06)
        approach = (0, 0, -1)
    if items and rng.uniform() < 0.6:
        parts.append(
            placement.item(rng, 0.75 * depth, rng.uniform(-0.5, 0.5) * half, plate, 0.1, 0.12)
        )
    inside = scene.region(
        "in the cage", low, high, approach, wide=placement.ACROSS, tilt=0.4, roll=np.pi
    )
    size = np.array([depth, width, height])
    return scene.Furniture(
        tuple(parts), (inside, inside, inside, *placement.close_beside(size)), size
    )


def draw(rng: np.random.Generator) -> scene.Scene:
    """One cage before the arm."""
    piece = build(rng)
    position, yaw = placement.pose(rng, (0.32, 0.44), (-0.8, 0.8), swivel=0.3)
    return scene.compose(
        "cage", (piece.placed(position, yaw),), placement.around(piece.size, position, yaw)
    )
