"""Problems to learn from: drawn on the host, from random streams that the benchmark never uses.

A problem is a scene, often with boxes that float in it, a start and a goal, and a way between them
that a sampling planner found: the expert's hint. In a share of them a box then stands on the goal,
as when something or someone blocks it (paper 3.1). The scenes are the benchmark's families and
`assembly`, or those of `foreign`, which nothing is learned from.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from drpbench.geometry import MAX_OBSTACLES, Obstacles
from drpbench.planning import polyline
from drpbench.planning.checker import sphere_checker
from drpbench.planning.host_ik import HostInverseKinematics
from drpbench.robot import PANDA, Robot

from . import assembly
from .composition import PAIRS, Group
from .families import FAMILIES
from .foreign import FOREIGN
from .generator import CHECKER_MARGIN, FREE_CLEARANCE, VERSION_SEED, Generator, Rejected
from .scene import Scene

TRAINING_STREAM = "training-2"
VALIDATION_STREAM = "validation"
SCENES: Mapping[str, Callable[[np.random.Generator], Scene]] = (
    FAMILIES | {assembly.NAME: assembly.draw} | FOREIGN
)
FAMILY_NAMES = tuple(SCENES)
AT_HOME = tuple(FAMILIES)
"""The families of the benchmark."""
ABROAD = tuple(FOREIGN)
LEARNED_FROM = (*AT_HOME, assembly.NAME)

ASSEMBLED_SHARE = 0.6  # of problems that are drawn from an assembly, where there are families too

OBSTRUCTED_SHARE = 0.3
FLOATING_SHARE = 0.4  # of scenes that have one to three floating boxes
HINT_WAYPOINTS = 64
_LEAST_WAY = {"ff": 0.3, "ft": 0.3, "tf": 0.3, "tt": 0.2}  # [m] from start to goal position
_REACH = np.array([[0.1, -0.8, 0.1], [0.9, 0.8, 1.0]])  # [m] corners of where boxes float
_TRIES = 20
_SHORTCUTS = 20  # of a hint: the expert shortens it anyway


@dataclass(frozen=True)
class Drawn:
    """One problem to learn from. Lengths [m], joints [rad], wxyz; obstacles padded to K = 24.

    `hint` is free of collision by the spheres, but for the box on the goal if it is `obstructed`.
    """

    index: int
    family: int  # of FAMILY_NAMES
    obstacles: Obstacles
    start: np.ndarray  # (J,) float32
    goal: np.ndarray  # (J,) float32
    hint: np.ndarray  # (64, J) float32
    obstructed: bool


class Drawer:
    """Draws the numbered problems of one stream. Holds a compiled checker, so make one and keep
    it."""

    def __init__(
        self,
        stream: str = TRAINING_STREAM,
        robot: Robot = PANDA,
        families: Sequence[str] = LEARNED_FROM,
    ):
        """`families` are names of `SCENES`. Raises ValueError for others, and for the benchmark's
        own stream."""
        if stream == "benchmark":
            raise ValueError("the benchmark's own stream is not for learning")
        unknown = [name for name in families if name not in SCENES]
        if unknown or not families:
            got = ", ".join(unknown) or "none"
            raise ValueError(f"expected families of {', '.join(SCENES)}, got {got}")
        self._stream = zlib.crc32(stream.encode())
        self._spheres = sphere_checker(CHECKER_MARGIN, robot)
        self._generator = Generator(
            self._spheres, None, HostInverseKinematics(robot), shortcuts=_SHORTCUTS
        )
        others = sum(name != assembly.NAME for name in families)
        shares = np.array(
            [
                ASSEMBLED_SHARE if name == assembly.NAME else (1.0 - ASSEMBLED_SHARE) / others
                for name in families
            ]
        )
        self._families, self._shares = tuple(families), shares / shares.sum()

    def draw(self, index: int) -> Drawn:
        """Problem number `index`; it depends on nothing but the stream and the number."""
        attempt = 0
        while True:
            rng = np.random.default_rng([VERSION_SEED, self._stream, index, attempt])
            try:
                return self._attempt(rng, index)
            except Rejected:
                attempt += 1

    def _attempt(self, rng: np.random.Generator, index: int) -> Drawn:
        name = self._families[rng.choice(len(self._families), p=self._shares)]
        pair = "ff" if name == "table" else PAIRS[rng.integers(len(PAIRS))]
        scene = SCENES[name](rng)
        if rng.uniform() < FLOATING_SHARE:
            scene = _with_boxes(scene, _floating(rng, int(rng.integers(1, 4))))
        group = Group(name, pair, level=0, count=0, distance=_LEAST_WAY[pair])
        start, goal, witness = self._generator.solve(rng, scene, group)
        obstructed = False
        if rng.uniform() < OBSTRUCTED_SHARE:
            blocked = self._blocked(rng, scene, start, goal)
            scene, obstructed = (scene, False) if blocked is None else (blocked, True)
        return Drawn(
            index=index,
            family=FAMILY_NAMES.index(name),
            obstacles=scene.obstacles.padded(MAX_OBSTACLES),
            start=start.astype(np.float32),
            goal=goal.astype(np.float32),
            hint=evenly(witness, HINT_WAYPOINTS, self._spheres.robot).astype(np.float32),
            obstructed=obstructed,
        )

    def _blocked(
        self, rng: np.random.Generator, scene: Scene, start: np.ndarray, goal: np.ndarray
    ) -> Scene | None:
        """The scene with a box on the goal that leaves the start free; None if none was found."""
        if scene.obstacles.count == MAX_OBSTACLES:
            return None
        place, _ = self._spheres.grip_pose(goal)
        # A tight start stays as tight as it was.
        clearance = min(self._spheres.clearance(start) - 1e-4, FREE_CLEARANCE)
        for _ in range(_TRIES):
            half = rng.uniform(0.05, 0.2, (1, 3))
            centre = (place + rng.normal(0.0, 0.05, 3))[None]
            blocked = _with_boxes(scene, Obstacles.boxes(half, centre, _orientations(rng, 1)))
            self._spheres.set_obstacles(blocked.obstacles)
            if self._spheres.clearance(goal) < 0.0 and self._spheres.free(start, clearance):
                return blocked
        return None


def _orientations(rng: np.random.Generator, count: int) -> np.ndarray:
    """Random unit quaternions (count, 4), wxyz."""
    q = rng.normal(size=(count, 4))
    return q / np.linalg.norm(q, axis=1, keepdims=True)


def _floating(rng: np.random.Generator, count: int) -> Obstacles:
    """Boxes in the arm's reach."""
    half = np.repeat(rng.uniform(0.05, 0.15, (count, 1)), 3, axis=1) * rng.uniform(
        0.6, 1, (count, 3)
    )
    return Obstacles.boxes(
        half, rng.uniform(_REACH[0], _REACH[1], (count, 3)), _orientations(rng, count)
    )


def _with_boxes(scene: Scene, boxes: Obstacles) -> Scene:
    """The scene and as many of the boxes as there is room for, in the precision that is stored."""
    fitting = boxes[: MAX_OBSTACLES - scene.obstacles.count]
    half_size, position, quaternion = (
        np.asarray(values, np.float32)
        for values in (fitting.half_size, fitting.position, fitting.quaternion)
    )
    return replace(
        scene,
        obstacles=scene.obstacles.joined(Obstacles.boxes(half_size, position, quaternion)),
    )


def evenly(waypoints: np.ndarray, count: int, robot: Robot = PANDA) -> np.ndarray:
    """`count` waypoints (count, J) at even steps along a polyline (m, J), its corners cut.

    A step is as long as the joint that is slowest relative to its limit needs for it.
    """
    steps = np.abs(np.diff(waypoints, axis=0)) / robot.velocity_limit
    return polyline.evenly_on_host(waypoints, steps.max(axis=1, initial=0.0), count)
