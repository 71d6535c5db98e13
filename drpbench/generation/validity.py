"""Whether a problem can be solved at all: both ends free, and a way between them.

By the collision spheres, and by the real meshes where they are at hand. A witness that comes with a
problem is looked at; without one, or where it touches, RRT-Connect searches for a way. Nothing is
asked beyond not touching: other people's goals are often a few millimetres clear.
"""

from collections.abc import Collection

import numpy as np

from drpbench.planning import motion
from drpbench.planning.checker import Checker, mesh_checker, sphere_checker
from drpbench.planning.rrt_connect import Planner
from drpbench.problems import TaskProblems
from drpbench.robot import Robot

_MARGIN = 0.045  # [m]: the longest step the planner may take in the open
_STEP = 0.005  # [m] of motion between the places of a way that are looked at
_ROOMS = (0.005, 0.0)  # [m] that a way keeps, if one can be found


class Validity:
    """Checks problems of one arm."""

    def __init__(self, robot: Robot, effort: int):
        """`effort` counts the configurations that are tried in search of a way."""
        self._spheres = sphere_checker(_MARGIN, robot)
        model = robot.meshes.find() if robot.meshes is not None else None
        self._meshes = None if model is None else mesh_checker(model, _MARGIN, robot)
        self._effort, self._robot = effort, robot

    @property
    def by_meshes(self) -> bool:
        """Whether the real meshes are at hand."""
        return self._meshes is not None

    def way(self, problems: TaskProblems, id: int) -> np.ndarray | str:
        """A way (m, J) float32 from start to goal of a problem, or what is wrong with it."""
        start, goal = (np.asarray(q[id], float) for q in (problems.start, problems.goal))
        checkers = {"spheres": self._spheres} | ({"meshes": self._meshes} if self._meshes else {})
        for checker in checkers.values():
            checker.set_obstacles(problems.obstacles[id])
        for end, q in (("start", start), ("goal", goal)):
            for by, checker in checkers.items():
                if (room := checker.clearance(q)) <= 0.0:
                    return f"the {end} touches something, {-1000 * room:.1f} mm deep by the {by}"
        given = np.asarray(problems.witness[id], float)
        if len(given) and self._free(given, start, goal, checkers.values()):
            return given.astype(np.float32)
        for room in _ROOMS:
            if min(self._spheres.clearance(q) for q in (start, goal)) <= room:
                continue
            rng = np.random.default_rng([id, 0])
            found = Planner(self._spheres, room).plan(rng, start, goal, self._effort)
            if found is not None and self._free(found, start, goal, checkers.values()):
                return found.astype(np.float32)
        told = "the way that was given touches something, and " if len(given) else ""
        return f"{told}no other way was found" if told else "no way was found"

    def _free(
        self, way: np.ndarray, start: np.ndarray, goal: np.ndarray, checkers: Collection[Checker]
    ) -> bool:
        if not (np.allclose(way[0], start, atol=1e-6) and np.allclose(way[-1], goal, atol=1e-6)):
            return False
        places = motion.samples(way, _STEP, self._robot)
        return all(checker.free(q) for checker in checkers for q in places)
