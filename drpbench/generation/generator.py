"""The problem generator: draws scenes, starts and goals until one problem has its certificate.

Problem number `index` of a task depends on nothing but its numbers: every attempt at it has a
random stream of its own, and effort is counted in collision checks, never in seconds.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from drpbench.generation import certificate
from drpbench.geometry import host_rotation as rotation
from drpbench.planning.checker import Checker
from drpbench.planning.host_ik import HostInverseKinematics
from drpbench.planning.mink_ik import InverseKinematics
from drpbench.planning.rrt_connect import Planner

from .composition import COMPOSITION, Group, group_of
from .families import FAMILIES
from .scene import Scene

GENERATOR_VERSION = 1
VERSION_SEED = 20251
BENCHMARK_STREAM = "benchmark"

FREE_CLEARANCE = 0.03  # [m] of a free start or goal
TIGHT_CLEARANCE = 0.0065  # [m] of a tight one: above the certificate's, so that meshes agree
PATH_CLEARANCE = 0.0065  # [m] that the planner keeps
CHECKER_MARGIN = 0.045  # [m]: the longest step the planner may take in the open
KEEP_STRAIGHT = 0.6  # share kept of furnished problems whose joint-space line is free

_POSES = 24  # poses tried for one start or goal before the scene is given up
_MAX_CHECKS = 20_000  # of the planner, about half a second
_SHORTCUTS = 60


@dataclass(frozen=True)
class Draft:
    """A generated problem with its certificate; joints [rad], lengths [m], all float32."""

    task: str
    index: int
    group: Group
    scene: Scene
    start: np.ndarray  # (J,)
    goal: np.ndarray  # (J,)
    goal_position: np.ndarray  # (3,)
    goal_quaternion: np.ndarray  # (4,)
    witness: np.ndarray  # (m, J)
    attempts: int


class Rejected(Exception):
    """This attempt gives no problem; the argument says at which stage."""


class Generator:
    """Makes problems one at a time. Holds the compiled checkers, so make one and keep it.

    `meshes` is a checker on the real meshes; without it certificates rest on the spheres alone. The
    arm is that of the checkers.
    """

    def __init__(
        self,
        spheres: Checker,
        meshes: Checker | None,
        ik: InverseKinematics | HostInverseKinematics | None = None,
        shortcuts: int = _SHORTCUTS,
        families: Mapping[str, Callable[[np.random.Generator], Scene]] = FAMILIES,
        groups: Callable[[str, int], Group] = group_of,
        keep_straight: float = KEEP_STRAIGHT,
    ):
        """`ik` is mink's unless another is given; `shortcuts` are tried on a witness. `groups` says
        of which group a task's problem is, and `families` draw its scene. The benchmark's problems
        are of the defaults."""
        self._families, self._group_of, self._keep_straight = families, groups, keep_straight
        self._spheres, self._meshes, self._shortcuts = spheres, meshes, shortcuts
        self._ik = ik or InverseKinematics(spheres.robot)
        self.rejections: dict[str, int] = {}

    def problem(
        self, task: str, index: int, stream: str | Sequence[int] = BENCHMARK_STREAM
    ) -> Draft:
        """Problem number `index` of `task`, of the named random stream, or of secret numbers.

        `stream` keeps what is drawn for training apart from what is drawn for the benchmark.
        """
        group = self._group_of(task, index)
        named = [zlib.crc32(stream.encode())] if isinstance(stream, str) else stream
        numbers = [VERSION_SEED, *named, list(COMPOSITION).index(task), index]
        attempt = 0
        while True:
            try:
                return self._attempt(
                    task, index, group, np.random.default_rng([*numbers, attempt]), attempt
                )
            except Rejected as reason:
                stage = str(reason)
                self.rejections[stage] = self.rejections.get(stage, 0) + 1
                attempt += 1

    def _attempt(
        self, task: str, index: int, group: Group, rng: np.random.Generator, attempt: int
    ) -> Draft:
        scene = self._families[group.family](rng)
        start, goal, witness = self.solve(rng, scene, group)
        if self._meshes is not None:
            self._meshes.set_obstacles(scene.obstacles)
        fault = certificate.certify(witness, start, goal, self._spheres, self._meshes).fault
        if fault is not None:
            raise Rejected("no certificate")
        position, matrix = self._spheres.grip_pose(goal)
        return Draft(
            task=task,
            index=index,
            group=group,
            scene=scene,
            start=start.astype(np.float32),
            goal=goal.astype(np.float32),
            goal_position=position.astype(np.float32),
            goal_quaternion=rotation.from_matrix(matrix).astype(np.float32),
            witness=witness.astype(np.float32),
            attempts=attempt + 1,
        )

    def solve(
        self, rng: np.random.Generator, scene: Scene, group: Group
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Start (J,), goal (J,) and witness (m, J) of the group's kind in a scene, by the spheres.

        Where the group `stays`, its goal is its start. Raises Rejected.
        """
        self._spheres.set_obstacles(scene.obstacles)
        if self._spheres.base_clearance() < 0.02:
            raise Rejected("furniture in the arm's base")
        start = self._configuration(rng, scene, group.pair[0])
        if group.stays:
            return start, start, start[None]
        goal = self._other_end(rng, scene, group, start)
        return start, goal, self._witness(rng, group, start, goal)

    def _configuration(
        self,
        rng: np.random.Generator,
        scene: Scene,
        kind: str,
        accept: Callable[[np.ndarray], bool] = lambda q: True,
    ) -> np.ndarray:
        """Configuration (J,) with the hand in a random free (f) or tight (t) region of the scene.

        Of float32 precision, as it will be stored.
        """
        regions = scene.tight if kind == "t" else scene.free
        clearance = TIGHT_CLEARANCE if kind == "t" else FREE_CLEARANCE
        for _ in range(_POSES):
            position, quaternion = regions[rng.integers(len(regions))].draw(rng)
            q = self._ik.solve(rng, position, quaternion, self._spheres, clearance)
            if q is None:
                continue
            q = q.astype(np.float32).astype(float)
            if self._spheres.free(q, clearance - 1e-5) and accept(q):
                return q
        raise Rejected(f"no {'tight' if kind == 't' else 'free'} pose")

    def _other_end(
        self, rng: np.random.Generator, scene: Scene, group: Group, start: np.ndarray
    ) -> np.ndarray:
        """A goal (J,) whose grip position is at least the group's distance from the start's."""
        origin, _ = self._spheres.grip_pose(start)

        def far_enough(q: np.ndarray) -> bool:
            away = np.linalg.norm(self._spheres.grip_pose(q)[0] - origin)
            return bool(away >= group.distance)

        return self._configuration(rng, scene, group.pair[1], far_enough)

    def _witness(
        self, rng: np.random.Generator, group: Group, start: np.ndarray, goal: np.ndarray
    ) -> np.ndarray:
        """Waypoints (m, J), float32 in value, from start to goal."""
        line_is_free = Planner(self._spheres, 0.0).straight(start, goal)
        if group.family != "table" and line_is_free and rng.uniform() > self._keep_straight:
            raise Rejected("the straight line is free")
        planner = Planner(self._spheres, PATH_CLEARANCE)
        path = planner.plan(rng, start, goal, _MAX_CHECKS)
        if path is None:
            raise Rejected("no path found")
        path = planner.shortcut(rng, path, self._shortcuts)
        return path.astype(np.float32).astype(float)
