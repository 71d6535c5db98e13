"""How an arm is drawn where its meshes are not at hand: a handful of solids. No part of the
collision model."""

from dataclasses import dataclass

import numpy as np

from .body_points import BodyPoints

Color = tuple[float, float, float]
"""Red, green, blue, 0 to 1."""
Point = tuple[float | int, float | int, float | int]
"""[m]"""
WHITE: Color = (0.93, 0.94, 0.95)
GREY: Color = (0.55, 0.57, 0.60)
DARK: Color = (0.20, 0.21, 0.23)
UPRIGHT = np.array([1.0, 0.0, 0.0, 0.0])
"""Quaternion wxyz of what is not turned."""


@dataclass(frozen=True)
class Solid:
    """A solid fixed in a frame of the arm (0 the base, 1 to J the joints', J + 1 the hand)."""

    frame: int
    kind: str
    """of `geometry.SHAPES`: box, cylinder (about its z) or sphere"""
    half_size: tuple[float, float, float]
    """[m] as in `Primitives`: half extents; radius, radius, half height; three times the radius."""
    position: np.ndarray  # (3,) [m]
    quaternion: np.ndarray  # (4,) wxyz
    color: Color


def ball(frame: int, center: Point, radius: float, color: Color) -> Solid:
    """A sphere."""
    return Solid(frame, "sphere", (radius,) * 3, np.array(center, float), UPRIGHT, color)


def balls(spheres: BodyPoints) -> tuple[Solid, ...]:
    """An arm as its collision spheres: what there is of any arm."""
    rows = zip(spheres.frame, spheres.local.tolist(), spheres.radius, strict=True)
    return tuple(
        ball(int(frame), (x, y, z), float(radius), WHITE) for frame, (x, y, z), radius in rows
    )
