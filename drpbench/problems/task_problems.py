"""The problems of one task of a set, as arrays."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from drpbench.contract import WAY_POINTS, Problem
from drpbench.errors import DrpbenchError
from drpbench.geometry import Obstacles
from drpbench.planning import polyline


class ProblemSetError(DrpbenchError):
    """The set, the task or the number asked for is not there, or the data are damaged."""


@dataclass(frozen=True, eq=False)
class TaskProblems:
    """n problems, numbered from 0, for an arm of J joints. Lengths [m], joints [rad], quaternions
    wxyz.

    Goal poses are those of the frame `grip`. `level` and `pair` are the task's and the generator's
    own: 0 and "" where there is none.
    """

    task: str
    obstacles: Obstacles  # (n, K), padded to the most that a problem has
    start: np.ndarray  # (n, J) float32
    goal: np.ndarray  # (n, J) float32
    goal_position: np.ndarray  # (n, 3) float32
    goal_quaternion: np.ndarray  # (n, 4) float32
    family: Sequence[str]
    pair: Sequence[str]
    level: np.ndarray  # (n,) int32
    witness: Sequence[np.ndarray]
    """One polyline (m, J) a problem, linear in joint space between its waypoints and free of
    collision in the static scene; (0, J) where none is known."""

    @property
    def count(self) -> int:
        """n, the number of problems."""
        return len(self.start)

    def require(self, ids: Sequence[int]) -> None:
        """Raises ProblemSetError for a number that there is not."""
        if outside := [id for id in ids if not 0 <= id < self.count]:
            raise ProblemSetError(
                f"there is no problem {outside[0]} in {self.task}; "
                f"ids go from 0 to {self.count - 1}"
            )

    def take(self, ids: Sequence[int]) -> Problem:
        """The numbered problems as a batch for the device."""
        index = np.asarray(ids, int)
        return Problem(
            id=index.astype(np.int32),
            level=self.level[index].astype(np.int32),
            start=self.start[index].astype(np.float32),
            goal=self.goal[index].astype(np.float32),
            goal_position=self.goal_position[index].astype(np.float32),
            goal_quaternion=self.goal_quaternion[index].astype(np.float32),
            obstacles=self.obstacles[index].primitives(),
            witness=np.stack([self._way(id) for id in index]) if len(index) else None,
        )

    def with_ways(self, ways: Mapping[int, np.ndarray]) -> TaskProblems:
        """Those of these numbers alone, numbered anew, each with this witness (m, J)."""
        index = np.array(list(ways), int)
        return replace(
            self,
            obstacles=self.obstacles[index],
            start=self.start[index],
            goal=self.goal[index],
            goal_position=self.goal_position[index],
            goal_quaternion=self.goal_quaternion[index],
            family=[self.family[id] for id in index],
            pair=[self.pair[id] for id in index],
            level=self.level[index],
            witness=list(ways.values()),
        )

    def _way(self, id: int) -> np.ndarray:
        """`WAY_POINTS` configurations (W, J) [rad] along the witness, at even steps of the joint
        that turns most; along the straight line where none is known."""
        path = np.asarray(self.witness[id], float)
        if not len(path):
            path = np.stack([self.start[id], self.goal[id]]).astype(float)
        steps = np.abs(np.diff(path, axis=0)).max(axis=1, initial=0.0)
        return polyline.evenly_on_host(path, steps, WAY_POINTS).astype(np.float32)
