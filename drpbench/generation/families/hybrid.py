"""Two kinds of furniture in one scene, or one kind among loose objects on the table."""

from __future__ import annotations

import numpy as np

from drpbench.generation import scene
from drpbench.generation.families import box, cubby, microwave, placement, shelf, wall_cabinet


def beside(rng: np.random.Generator) -> tuple[list[scene.Furniture], list[scene.HandRegion]]:
    """Two different pieces, one to the arm's left and one to its right."""
    makers = (
        lambda: box.build(rng, items=2, compact=True),
        lambda: cubby.build(rng, items=2, compact=True),
        lambda: microwave.build(rng, items=0, compact=True),
        lambda: shelf.build(rng, items=3, compact=True),
    )
    placed: list[scene.Furniture] = []
    free: list[scene.HandRegion] = []
    for side, maker in zip((1, -1), rng.permutation(len(makers))[:2], strict=True):
        piece = makers[maker]()
        distance = (0.34, 0.42) if maker == 0 else (0.40, 0.50)
        position, yaw = placement.pose(rng, distance, (side * 0.70, side * 1.0), swivel=0.1)
        placed.append(piece.placed(position, yaw))
        free += placement.around(piece.size, position, yaw)
    return placed, free


def stacked(rng: np.random.Generator) -> tuple[list[scene.Furniture], list[scene.HandRegion]]:
    """A box on the table below a wall cabinet."""
    upper = wall_cabinet.build(rng, items=3, compact=True, counter=0)
    position, yaw = placement.pose(rng, (0.48, 0.56), (-0.6, 0.6), swivel=0.1)
    lower = box.build(rng, items=2, compact=True)
    ahead = np.array([np.cos(yaw), np.sin(yaw), 0.0])
    below = position - (lower.size[0] - 0.5 * upper.size[0]) * ahead
    free = [r for r in placement.around(upper.size, position, yaw) if r.place != "above"]
    return [upper.placed(position, yaw), lower.placed(below, yaw)], free


def cluttered(rng: np.random.Generator) -> tuple[list[scene.Furniture], list[scene.HandRegion]]:
    """A microwave or a cubby among cartons, bottles and balls on the table."""
    if rng.uniform() < 0.5:
        piece = microwave.build(rng, items=1)
    else:
        piece = cubby.build(rng, items=2, compact=True)
    position, yaw = placement.pose(rng, (0.44, 0.56), (-0.5, 0.5))
    half_angle = np.arctan2(piece.size[1] / 2, position[0]) + 0.25
    objects: list[scene.Primitive] = []
    spots: list[np.ndarray] = []
    for _ in range(int(rng.integers(6, 11))):
        bearing = yaw + rng.choice((-1, 1)) * (half_angle + rng.uniform(0.0, 0.9))
        spot = rng.uniform(0.35, 0.65) * np.array([np.cos(bearing), np.sin(bearing)])
        if all(np.linalg.norm(spot - other) > 0.15 for other in spots):
            spots.append(spot)
            x, y = spot
            objects.append(placement.item(rng, x, y, 0.0, 0.14, 0.35))
    loose = scene.Furniture(tuple(objects), (), np.zeros(3))
    free = list(placement.around(piece.size, position, yaw))
    return [piece.placed(position, yaw), loose], free


def draw(rng: np.random.Generator) -> scene.Scene:
    """One of the three arrangements, side by side most often."""
    arrange = (beside, stacked, cluttered)[rng.choice(3, p=(0.5, 0.2, 0.3))]
    placed, free = arrange(rng)
    return scene.compose("hybrid", tuple(placed), tuple(free))
