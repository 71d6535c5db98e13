"""Where furniture stands around the arm, the open space beside it, and loose objects on
surfaces."""

from __future__ import annotations

from typing import Any

import numpy as np

from drpbench.generation import scene
from drpbench.geometry import host_rotation as rotation

FORWARD_DOWN = np.array([1.0, 0.0, -0.7])
ACROSS = np.array([0.0, 1.0, 0.0])


def pose(
    rng: np.random.Generator,
    distance: tuple[float, float],
    bearing: tuple[float, float],
    height: float = 0.0,
    swivel: float = 0.15,
) -> tuple[np.ndarray, float]:
    """Position (3,) and yaw of furniture that faces the arm.

    `distance` and `bearing` are ranges of the front's distance [m] and direction [rad] from the
    arm's base; `swivel` [rad] is how far the front may be turned away from the arm.
    """
    d, b = rng.uniform(*distance), rng.uniform(min(bearing), max(bearing))
    position = np.array([d * np.cos(b), d * np.sin(b), height])
    return position, b + rng.uniform(-swivel, swivel)


def around(size: np.ndarray, position: np.ndarray, yaw: float) -> tuple[scene.HandRegion, ...]:
    """Open space about furniture of `size` (depth, width, height): left, right, above, before.

    Hands there come from anywhere within 60 degrees of forward and down.
    """
    depth, width, height = size
    floor = -position[2]  # the tabletop, in the furniture's frame
    side: dict[str, Any] = dict(approach=FORWARD_DOWN, wide=ACROSS, tilt=np.pi / 3, roll=np.pi)
    low, high = floor + 0.10, max(floor + 0.45, min(height, floor + 0.65))
    half = width / 2
    turn = rotation.axis_angle((0, 0, 1), yaw)
    regions = (
        scene.region("left", (-0.2, half + 0.08, low), (depth, half + 0.40, high), **side),
        scene.region("right", (-0.2, -half - 0.40, low), (depth, -half - 0.08, high), **side),
        scene.region("above", (-0.1, -half, height + 0.06), (depth, half, height + 0.35), **side),
        scene.region("before", (-0.25, -half, low), (-0.08, half, high), **side),
    )
    return tuple(scene.moved(r, position, turn) for r in regions)


def close_beside(size: np.ndarray, low: float = 0.06) -> tuple[scene.HandRegion, ...]:
    """Just outside the left and right faces of furniture of `size`: a hand pointing down there."""
    depth, width, height = size
    high = max(low + 0.02, min(height - 0.05, 0.25))
    regions = []
    for place, side in (("close to the left", 1), ("close to the right", -1)):
        y = sorted((side * (width / 2 + 0.05), side * (width / 2 + 0.09)))
        regions.append(
            scene.region(
                place,
                (0.1 * depth, y[0], low),
                (0.8 * depth, y[1], high),
                (0.3, 0, -1),
                wide=(1.0, 0.0, 0.0),
                tilt=0.3,
                roll=0.4,
            )
        )
    return tuple(regions)


def item(
    rng: np.random.Generator, x: float, y: float, z: float, width: float, height: float
) -> scene.Primitive:
    """A loose object at most `width` across and `height` tall, standing on the level `z` at (x, y).

    A box (a carton), a cylinder (a can, a bottle) or a sphere (a ball).
    """
    shape = rng.choice(3, p=(0.4, 0.45, 0.15))
    across = rng.uniform(0.6, 1.0) * width
    tall = rng.uniform(0.5, 1.0) * height
    if shape == scene.BOX:
        turn = rotation.axis_angle((0, 0, 1), rng.uniform(-0.3, 0.3))
        depth = rng.uniform(0.5, 0.8) * across
        return scene.box((depth, 0.8 * across, tall), (x, y, z + tall / 2), turn)
    if shape == scene.CYLINDER:
        return scene.cylinder(across / 2, tall, (x, y, z + tall / 2))
    radius = min(across, tall) / 2
    return scene.sphere(radius, (x, y, z + radius))


def slots(
    rng: np.random.Generator, low: float, high: float, count: int
) -> list[tuple[float, float]]:
    """`count` disjoint intervals (centre, width) that part [low, high] unevenly, left to right."""
    shares = rng.uniform(0.7, 1.3, count)
    edges = low + (high - low) * np.concatenate([[0.0], np.cumsum(shares) / shares.sum()])
    return [((a + b) / 2, b - a) for a, b in zip(edges[:-1], edges[1:], strict=True)]
