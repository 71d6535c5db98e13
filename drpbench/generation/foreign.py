"""Foreign scenes: a yardstick for how far what was learned carries.

Nothing here is learned from, and no code is shared with what draws the scenes to learn from, but
for the primitives and hand regions of `scene.py`. Settings may be chosen on these scenes; the
frozen problems and other people's stay for judging.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from drpbench.geometry import BOX, CYLINDER, SPHERE
from drpbench.geometry import host_rotation as rotation

from .scene import HandRegion, Primitive, Scene, obstacles_of

_Z = np.array([0.0, 0.0, 1.0])


class _Draft:
    """A scene while it is drawn, in a frame that is turned by `yaw` [rad] about the base."""

    def __init__(self, yaw: float, bearer: tuple[float, float, float]):
        """`bearer` are the half size in x and y and the height of the top of what bears the arm."""
        self._yaw = yaw
        self._turn = rotation.axis_angle(_Z, yaw)
        c, s = np.cos(yaw), np.sin(yaw)
        self._matrix = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]])
        self._parts: list[Primitive] = []
        self._tight: list[HandRegion] = []
        x, y, top = bearer
        self.solid(BOX, (x, y, 0.2), (0, 0, top - 0.2))

    def solid(
        self,
        kind: int,
        half: tuple[float, float, float],
        at: tuple[float, float, float],
        turn: np.ndarray | None = None,
    ) -> None:
        own = self._turn if turn is None else rotation.multiply(self._turn, turn)
        self._parts.append(
            Primitive(kind, np.array(half, float), self._matrix @ np.array(at, float), own)
        )

    def hand(
        self,
        at: tuple[float, float, float],
        room: tuple[float, float, float],
        approach: tuple[float, float, float],
        tilt: float = 0.4,
        roll: float = np.pi,
    ) -> None:
        wide = (0.0, 1.0, 0.0) if abs(approach[1]) < 0.9 else (1.0, 0.0, 0.0)
        self._tight.append(
            HandRegion(
                "inside",
                self._matrix @ np.array(at, float),
                np.array(room, float),
                np.array(approach, float),
                np.array(wide),
                tilt,
                roll,
                self._turn,
            )
        )

    def scene(self, name: str, rng: np.random.Generator) -> Scene:
        parts = self._parts
        free = []
        for turn in rng.uniform(-1.2, 1.2, 3):
            away, angle = rng.uniform(0.3, 0.55), self._yaw + turn
            centre = np.array([away * np.cos(angle), away * np.sin(angle), rng.uniform(0.2, 0.7)])
            ahead = np.array([np.cos(angle), np.sin(angle), -rng.uniform(0, 1)])
            free.append(
                HandRegion(
                    "outside", centre, np.full(3, 0.12), ahead, np.array([0, 0, 1.0]), 1.0, np.pi
                )
            )
        return Scene(name, obstacles_of(parts), tuple(self._tight) or tuple(free), tuple(free))


_COLUMN = (0.09, 0.09, -0.02)  # the arm stands on a column: there is no ground


def _side_shelf(rng: np.random.Generator) -> Scene:
    """Three to five open levels between two cheeks, beside the arm."""
    yaw = rng.choice((-1, 1)) * rng.uniform(0.9, 2.2)
    draft = _Draft(yaw, _COLUMN)
    front, deep, wide = rng.uniform(0.35, 0.55), rng.uniform(0.2, 0.35), rng.uniform(0.5, 0.9)
    t, z = rng.uniform(0.006, 0.02), rng.uniform(-0.4, 0.0)
    levels = int(rng.integers(3, 6))
    gap = rng.uniform(0.2, 0.35)
    for level in range(levels):
        draft.solid(BOX, (deep / 2, wide / 2, t / 2), (front + deep / 2, 0, z + level * gap))
        if level + 1 < levels:
            for _ in range(int(rng.integers(0, 3))):
                r, h = rng.uniform(0.02, 0.04), rng.uniform(0.06, 0.16)
                y = rng.uniform(-0.45, 0.45) * wide
                foot = z + level * gap + t / 2
                draft.solid(CYLINDER, (r, r, h / 2), (front + 0.7 * deep, y, foot + h / 2))
            middle = z + (level + 0.5) * gap
            draft.hand(
                (front + 0.4 * deep, 0, middle),
                (0.25 * deep, 0.35 * wide, 0.3 * gap),
                (1, 0, 0),
            )
    high = (levels - 1) * gap
    for side in (-1, 1):
        at = (front + deep / 2, side * wide / 2, z + high / 2)
        draft.solid(BOX, (deep / 2, t / 2, high / 2), at)
    return draft.scene("side shelf", rng)


def _sunken_bin(rng: np.random.Generator) -> Scene:
    """A bin with leaning walls, its rim near or below the base."""
    draft = _Draft(rng.uniform(-1.8, 1.8), _COLUMN)
    x, rim = rng.uniform(0.45, 0.6), rng.uniform(-0.15, 0.15)
    half, deep, lean = rng.uniform(0.13, 0.25), rng.uniform(0.15, 0.35), rng.uniform(0.0, 0.3)
    t = rng.uniform(0.005, 0.015)
    draft.solid(BOX, (half, half, t), (x, 0, rim - deep))
    for i in range(4):
        angle = i * np.pi / 2
        c, s = np.cos(angle), np.sin(angle)
        turn = rotation.multiply(
            rotation.axis_angle(_Z, angle), rotation.axis_angle((0, 1, 0), lean)
        )
        off = half + 0.5 * deep * np.sin(lean)
        at = (x + c * off, s * off, rim - deep / 2)
        draft.solid(BOX, (t, half + deep * np.sin(lean), deep / 2), at, turn)
    for _ in range(int(rng.integers(0, 3))):
        r = rng.uniform(0.02, 0.05)
        at = (x + rng.uniform(-0.5, 0.5) * half, rng.uniform(-0.5, 0.5) * half, rim - deep + r)
        draft.solid(SPHERE, (r, r, r), at)
    draft.hand((x, 0, rim - 0.5 * deep), (0.4 * half, 0.4 * half, 0.3 * deep), (0, 0, -1))
    return draft.scene("sunken bin", rng)


def _bar_cage(rng: np.random.Generator) -> Scene:
    """Upright bars on three sides and a lid: in from the front."""
    draft = _Draft(rng.uniform(-2.0, 2.0), (0.4, 0.4, -0.01))
    front, deep, wide = rng.uniform(0.3, 0.4), rng.uniform(0.3, 0.4), rng.uniform(0.36, 0.55)
    low, tall, r = rng.uniform(-0.1, 0.3), rng.uniform(0.35, 0.55), rng.uniform(0.006, 0.014)
    for x in np.linspace(front, front + deep, 4):
        for side in (-1, 1):
            draft.solid(CYLINDER, (r, r, tall / 2), (x, side * wide / 2, low + tall / 2))
    for y in np.linspace(-wide / 2, wide / 2, 6)[1:-1]:
        draft.solid(CYLINDER, (r, r, tall / 2), (front + deep, y, low + tall / 2))
    for z in (low, low + tall):
        draft.solid(BOX, (deep / 2, wide / 2, 0.006), (front + deep / 2, 0, z))
    draft.hand(
        (front + 0.3 * deep, 0, low + 0.5 * tall), (0.25 * deep, 0.3 * wide, 0.3 * tall), (1, 0, 0)
    )
    return draft.scene("bar cage", rng)


def _bench(rng: np.random.Generator) -> Scene:
    """A table with things on it and no ground: to grasp them, and to reach beneath."""
    draft = _Draft(rng.uniform(-1.5, 1.5), _COLUMN)
    x, top = rng.uniform(0.5, 0.65), rng.uniform(0.05, 0.4)
    half = (rng.uniform(0.2, 0.3), rng.uniform(0.3, 0.6), rng.uniform(0.008, 0.02))
    draft.solid(BOX, half, (x, 0, top - half[2]))
    for sx in (-1, 1):
        for sy in (-1, 1):
            at = (x + 0.9 * sx * half[0], 0.9 * sy * half[1], top - 0.4)
            draft.solid(CYLINDER, (0.02, 0.02, 0.4 - 2 * half[2]), at)
    for _ in range(int(rng.integers(3, 9))):
        r, tall = rng.uniform(0.012, 0.03), rng.uniform(0.06, 0.2)
        there = x + rng.uniform(-0.8, 0.7) * half[0]
        aside = rng.uniform(-0.8, 0.8) * half[1]
        kind = int(rng.choice((BOX, CYLINDER)))
        draft.solid(kind, (r, r, tall / 2), (there, aside, top + tall / 2))
        grasp = (there, aside, top + 0.8 * tall)
        draft.hand(grasp, (0.003, 0.003, 0.1 * tall), (0, 0, -1), tilt=0.25)
    draft.hand((x - 0.1, 0, top - 0.2), (0.15, 0.7 * half[1], 0.08), (1, 0, 0), tilt=0.6)
    draft.hand((x - 0.1, 0, top - 0.2), (0.15, 0.7 * half[1], 0.08), (1, 0, 0), tilt=0.6)
    return draft.scene("bench", rng)


def _slats(rng: np.random.Generator) -> Scene:
    """A row of upright slats, staggered, with gaps to reach into."""
    draft = _Draft(rng.uniform(-2.0, 2.0), (0.6, 0.6, 0.0))
    count, gap, t = int(rng.integers(3, 6)), rng.uniform(0.15, 0.26), rng.uniform(0.004, 0.015)
    deep, tall = rng.uniform(0.12, 0.22), rng.uniform(0.3, 0.7)
    for i in range(count):
        y = (i - (count - 1) / 2) * gap
        x = rng.uniform(0.38, 0.5) + deep
        draft.solid(BOX, (deep, t, tall / 2), (x, y, tall / 2 + rng.uniform(0, 0.1)))
        if i + 1 < count:
            at = (0.5, y + gap / 2, rng.uniform(0.15, max(0.2, tall - 0.1)))
            draft.hand(at, (0.06, 0.02, 0.06), (1, 0, -0.2), tilt=0.4, roll=np.pi)
    return draft.scene("slats", rng)


def _heap(rng: np.random.Generator) -> Scene:
    """Solids of all shapes anywhere about the arm."""
    draft = _Draft(rng.uniform(-np.pi, np.pi), _COLUMN)
    for _ in range(int(rng.integers(6, 20))):
        turn = rng.normal(size=4)
        turn /= np.linalg.norm(turn)
        direction = rng.normal(size=3)
        away = rng.uniform(0.4, 0.9) * direction / np.linalg.norm(direction)
        at = (away[0], away[1], 0.35 + away[2])
        kind = int(rng.choice((BOX, CYLINDER, SPHERE)))
        a, b, c = rng.uniform(0.03, 0.12, 3)
        half = {BOX: (a, b, c), CYLINDER: (a, a, b), SPHERE: (a, a, a)}[kind]
        draft.solid(kind, half, at, turn)
        near = float(a + 0.09)
        draft.hand(at, (near, near, near), (1, 0, 0), tilt=np.pi)
    return draft.scene("heap", rng)


FOREIGN: dict[str, Callable[[np.random.Generator], Scene]] = {
    "side shelf": _side_shelf,
    "sunken bin": _sunken_bin,
    "bar cage": _bar_cage,
    "bench": _bench,
    "slats": _slats,
    "heap": _heap,
}
