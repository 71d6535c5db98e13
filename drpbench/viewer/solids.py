"""Boxes, cylinders and spheres as triangles, and the arm's links made of them."""

from collections.abc import Sequence
from functools import cache

import numpy as np

from drpbench.geometry import BOX, CYLINDER, SHAPES, SPHERE
from drpbench.robot import Robot

Mesh = tuple[np.ndarray, np.ndarray]
"""Vertices (V, 3) [m] and triangles (F, 3), outsides counter-clockwise. Sharp edges have their
vertices twice."""
_ROUND = 28  # corners of a circle


def solid(kind: int, half_size: Sequence[float] | np.ndarray) -> Mesh:
    """A primitive about the origin; `half_size` as in `Primitives`."""
    vertices, faces = {BOX: _cube, CYLINDER: _rod, SPHERE: _ball}[int(kind)]()
    return vertices * np.asarray(half_size, float), faces


@cache
def _cube() -> Mesh:
    square = np.array([(-1, -1, 1), (1, -1, 1), (1, 1, 1), (-1, 1, 1)], float)
    # The top face, turned to each side: cyclic changes of the axes, and half turns about one of
    # them.
    turned = [
        np.roll(square * flip, k, axis=1) for flip in ((1, 1, 1), (1, -1, -1)) for k in range(3)
    ]
    faces = [np.array([(0, 1, 2), (0, 2, 3)]) + 4 * i for i in range(6)]
    return np.concatenate(turned), np.concatenate(faces)


@cache
def _rod() -> Mesh:
    ring = _circle()
    n = len(ring)
    low, high = (np.column_stack([ring, np.full(n, z)]) for z in (-1.0, 1.0))
    here = np.arange(n)
    after = (here + 1) % n
    side = np.concatenate(
        [np.column_stack([here, after, after + n]), np.column_stack([here, after + n, here + n])]
    )
    fan = np.column_stack([np.zeros(n - 2, int), here[1:-1], here[2:]])
    caps = [fan[:, ::-1] + 2 * n, fan + 3 * n]
    return np.concatenate([low, high, low, high]), np.concatenate([side, *caps])


@cache
def _ball() -> Mesh:
    ring, rows = _circle(), _ROUND // 2
    n = len(ring)
    polar = np.linspace(0.0, np.pi, rows + 1)
    vertices = np.concatenate(
        [np.column_stack([np.sin(a) * ring, np.full(n, -np.cos(a))]) for a in polar]
    )
    here = (np.arange(rows)[:, None] * n + np.arange(n)).ravel()
    after = (np.arange(rows)[:, None] * n + (np.arange(n) + 1) % n).ravel()
    faces = [
        np.column_stack([here, after, after + n]),
        np.column_stack([here, after + n, here + n]),
    ]
    return vertices, np.concatenate(faces)


def _circle() -> np.ndarray:
    angle = np.linspace(0.0, 2.0 * np.pi, _ROUND, endpoint=False)
    return np.column_stack([np.cos(angle), np.sin(angle)])


def _turned(vertices: np.ndarray, quaternion: np.ndarray) -> np.ndarray:
    """v + 2 r x (r x v + w v) for a unit quaternion (w, r)."""
    w, r = quaternion[0], quaternion[1:]
    return vertices + 2.0 * np.cross(r, np.cross(r, vertices) + w * vertices)


def joined(meshes: list[Mesh]) -> Mesh:
    """Several as one."""
    starts = np.cumsum([0, *(len(vertices) for vertices, _ in meshes)])
    faces = [faces + start for (_, faces), start in zip(meshes, starts, strict=False)]
    return np.concatenate([vertices for vertices, _ in meshes]), np.concatenate(faces)


@cache
def links(robot: Robot) -> dict[tuple[int, tuple[float, float, float]], Mesh]:
    """The arm's solids in their frames, 0 the base and the last one the hand: one mesh a frame and
    colour."""
    parts: dict[tuple[int, tuple[float, float, float]], list[Mesh]] = {}
    for piece in robot.solids:
        vertices, faces = solid(SHAPES.index(piece.kind), piece.half_size)
        placed = _turned(vertices, piece.quaternion) + piece.position
        parts.setdefault((piece.frame, piece.color), []).append((placed, faces))
    return {part: joined(meshes) for part, meshes in parts.items()}
