"""A static scene on the host: primitives in numpy, and the regions in which a hand is asked for.

A scene family (`families/`) builds `Furniture` in a frame of its own and places it around the arm;
`compose` turns the placed pieces into a `Scene`. Furniture frame: origin on the floor in the middle
of the front, x into the furniture (away from the arm), y to its left, z up.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from drpbench.geometry import (
    BOX,
    CYLINDER,
    MAX_OBSTACLES,
    SPHERE,
    Obstacles,
    quaternion_to_matrix,
)
from drpbench.geometry import host_rotation as rotation

UPRIGHT = np.array([1.0, 0.0, 0.0, 0.0])
AXIS_X = rotation.axis_angle((0, 1, 0), np.pi / 2)  # turns a cylinder's axis from z to x
AXIS_Y = rotation.axis_angle((1, 0, 0), -np.pi / 2)  # turns a cylinder's axis from z to y


@dataclass(frozen=True)
class Primitive:
    """A box, cylinder (axis z) or sphere: `half_size` (3,) [m], `position` (3,), `quaternion`
    (4,)."""

    kind: int
    half_size: np.ndarray
    position: np.ndarray
    quaternion: np.ndarray = field(default_factory=lambda: UPRIGHT)


def obstacles_of(parts: Sequence[Primitive]) -> Obstacles:
    """The primitives, rounded to the precision that is stored."""
    return Obstacles.of(
        np.array([p.kind for p in parts], np.int32),
        np.array([p.half_size for p in parts], np.float32),
        np.array([p.position for p in parts], np.float32),
        np.array([p.quaternion for p in parts], np.float32),
    )


def box(size: ArrayLike, position: ArrayLike, quaternion: np.ndarray = UPRIGHT) -> Primitive:
    """Box of full extents `size` (3,) [m] about `position`."""
    return Primitive(BOX, np.asarray(size, float) / 2, np.asarray(position, float), quaternion)


def span(low: ArrayLike, high: ArrayLike) -> Primitive:
    """Box from the corner `low` (3,) to the corner `high` (3,) [m]."""
    first, last = np.asarray(low, float), np.asarray(high, float)
    return box(last - first, (first + last) / 2)


def cylinder(
    radius: float, height: float, position: ArrayLike, quaternion: np.ndarray = UPRIGHT
) -> Primitive:
    """Cylinder about `position`, its axis along z of its own frame."""
    half_size = np.array([radius, radius, height / 2])
    return Primitive(CYLINDER, half_size, np.asarray(position, float), quaternion)


def bar(radius: float, start: ArrayLike, end: ArrayLike) -> Primitive:
    """Cylinder whose axis runs from the point `start` (3,) to the point `end` (3,)."""
    first, last = np.asarray(start, float), np.asarray(end, float)
    direction = last - first
    length = float(np.linalg.norm(direction))
    turn = np.cross((0, 0, 1), direction / length)
    sine, cosine = np.linalg.norm(turn), direction[2] / length
    quaternion = rotation.axis_angle(turn, np.arctan2(sine, cosine)) if sine > 1e-9 else UPRIGHT
    return cylinder(radius, length, (first + last) / 2, quaternion)


def sphere(radius: float, position: ArrayLike) -> Primitive:
    """Sphere about `position`."""
    return Primitive(SPHERE, np.full(3, float(radius)), np.asarray(position, float))


@dataclass(frozen=True)
class HandRegion:
    """Where a hand may be: a box of grip positions and the directions it may come from.

    `centre` (3,) and `half_extent` (3,) [m] of the box, `quaternion` (4,) of its frame. The hand's
    z axis (which points out of the palm) lies within `tilt` [rad] of `approach` (3,); the hand's y
    axis (the wide one, along which the fingers open) within `roll` [rad] of `wide` (3,) or of its
    opposite. The last two are in the box's frame. `place` names what the hand would be in.
    """

    place: str
    centre: np.ndarray
    half_extent: np.ndarray
    approach: np.ndarray
    wide: np.ndarray
    tilt: float
    roll: float
    quaternion: np.ndarray = field(default_factory=lambda: UPRIGHT)

    def draw(self, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """Grip position (3,) and quaternion (4,) in the frame the region is expressed in."""
        frame = quaternion_to_matrix(self.quaternion)
        position = self.centre + frame @ (rng.uniform(-1, 1, 3) * self.half_extent)
        z = frame @ (self.approach / np.linalg.norm(self.approach))
        azimuth = rng.uniform(0, 2 * np.pi)
        # Uniform over the spherical cap of half angle `tilt` about the approach.
        polar = np.arccos(1 - rng.uniform() * (1 - np.cos(self.tilt)))
        helper = np.eye(3)[np.argmin(np.abs(z))]
        e1 = np.cross(z, helper)
        e1 /= np.linalg.norm(e1)
        e2 = np.cross(z, e1)
        z = np.cos(polar) * z + np.sin(polar) * (np.cos(azimuth) * e1 + np.sin(azimuth) * e2)
        roll = rng.uniform(-self.roll, self.roll) + np.pi * rng.integers(2)
        y = frame @ self.wide
        y = y - (y @ z) * z
        y /= np.linalg.norm(y)
        y = np.cos(roll) * y + np.sin(roll) * np.cross(z, y)
        return position, rotation.from_matrix(np.column_stack([np.cross(y, z), y, z]))


def region(
    place: str,
    low: ArrayLike,
    high: ArrayLike,
    approach: ArrayLike,
    wide: ArrayLike,
    tilt: float,
    roll: float,
) -> HandRegion:
    """`HandRegion` over the box from `low` (3,) to `high` (3,)."""
    first, last = np.asarray(low, float), np.asarray(high, float)
    half_extent = np.maximum((last - first) / 2, 0.0)
    return HandRegion(
        place,
        (first + last) / 2,
        half_extent,
        np.asarray(approach, float),
        np.asarray(wide, float),
        tilt,
        roll,
    )


@dataclass(frozen=True)
class Furniture:
    """Primitives and tight hand regions in the furniture's own frame, and its outer `size` (3,)
    [m].

    `size` is depth (x), width (y) and height (z) of the body itself, doors and drawers apart.
    """

    parts: tuple[Primitive, ...]
    tight: tuple[HandRegion, ...]
    size: np.ndarray

    def placed(self, position: ArrayLike, yaw: float) -> Furniture:
        """The same furniture with its frame at `position` (3,), turned by `yaw` [rad] about z."""
        origin, turn = np.asarray(position, float), rotation.axis_angle((0, 0, 1), yaw)
        matrix = quaternion_to_matrix(turn)
        parts = tuple(
            Primitive(
                p.kind,
                p.half_size,
                origin + matrix @ p.position,
                rotation.multiply(turn, p.quaternion),
            )
            for p in self.parts
        )
        tight = tuple(moved(r, origin, turn) for r in self.tight)
        return Furniture(parts, tight, self.size)


def moved(hand: HandRegion, position: np.ndarray, turn: np.ndarray) -> HandRegion:
    """A region carried along by a frame at `position` (3,) with orientation `turn` (4,)."""
    return HandRegion(
        hand.place,
        position + quaternion_to_matrix(turn) @ hand.centre,
        hand.half_extent,
        hand.approach,
        hand.wide,
        hand.tilt,
        hand.roll,
        rotation.multiply(turn, hand.quaternion),
    )


@dataclass(frozen=True)
class Scene:
    """The obstacles, the table first, and the hand regions.

    The obstacles' float32 numbers are those that are stored, so that whatever is verified is
    verified on these.
    """

    family: str
    obstacles: Obstacles
    tight: tuple[HandRegion, ...]
    free: tuple[HandRegion, ...]


TABLE = span((-0.5, -1.0, -0.05), (1.3, 1.0, 0.0))
"""The tabletop: its upper face is exactly z = 0, and the arm's base stands on it."""


def compose(family: str, furniture: tuple[Furniture, ...], free: tuple[HandRegion, ...]) -> Scene:
    """Scene of the table and the placed `furniture`, rounded to the precision that is stored."""
    parts = [TABLE, *(p for piece in furniture for p in piece.parts)]
    if len(parts) > MAX_OBSTACLES:
        raise ValueError(f"{family}: {len(parts)} obstacles, at most {MAX_OBSTACLES} are allowed")
    return Scene(
        family,
        obstacles_of(parts),
        tuple(r for piece in furniture for r in piece.tight),
        free,
    )
