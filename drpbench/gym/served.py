"""Which problems an environment serves: the frozen ones by number, or training problems by number."""

from collections.abc import Sequence
from typing import Any, Protocol, runtime_checkable

import numpy as np

from drpbench.contract import Problem
from drpbench.envs import Task
from drpbench.evaluation.run import require_runnable
from drpbench.geometry import stacked
from drpbench.problems import ProblemSet, goal_poses, load_set
from drpbench.robot import PANDA, Robot


@runtime_checkable
class Problems(Protocol):
    """Numbered problems of one task."""

    stream: int
    """The random stream of their worlds, see `drpbench.rollout.batch.instance_key`."""

    def require(self, ids: Sequence[int]) -> None:
        """Raises ValueError for a number that there is not."""

    def draw(self, rng: np.random.Generator, count: int) -> list[int]:
        """The next `count` numbers."""

    def restart(self) -> None:
        """Forgets what was drawn."""

    def take(self, ids: Sequence[int]) -> Problem:
        """The numbered problems as a batch."""


class Frozen:
    """The problems of a set, in a random order that comes to each of them before it begins again."""

    stream = 0  # as in `drpbench run`: the same boxes, the same points

    def __init__(self, task: Task, problem_set: ProblemSet):
        self._problems = problem_set.task(task.name)
        self._left: list[int] = []

    def require(self, ids: Sequence[int]) -> None:
        self._problems.require(ids)

    def draw(self, rng: np.random.Generator, count: int) -> list[int]:
        while len(self._left) < count:
            self._left += rng.permutation(self._problems.count).tolist()
        drawn, self._left = self._left[:count], self._left[count:]
        return drawn

    def restart(self) -> None:
        self._left = []

    def take(self, ids: Sequence[int]) -> Problem:
        return self._problems.take(ids)


_MOST = 2**31  # training problems there are numbers for


class Training:
    """Problems to learn from, drawn on the host from the stream of `drpbench data`.

    Those with a box on their goal are passed over for the next number that has none. The task says which
    level a problem has, which sets number and size of its moving boxes, and whether it begins at the goal.
    """

    stream = 2  # no box and no point as in the benchmark

    def __init__(self, task: Task, robot: Robot = PANDA):
        # What draws problems is heavy to import, and of no use to who asks for the frozen ones.
        from drpbench.generation.training_problems import TRAINING_STREAM, Drawer

        self._task, self._robot = task, robot
        self._drawer = Drawer(TRAINING_STREAM, robot)

    def require(self, ids: Sequence[int]) -> None:
        for id in ids:
            if not 0 <= id < _MOST:
                raise ValueError(f"no training problem {id}; ids go from 0 to {_MOST - 1}")

    def draw(self, rng: np.random.Generator, count: int) -> list[int]:
        return rng.integers(_MOST, size=count).tolist()

    def restart(self) -> None:
        pass

    def take(self, ids: Sequence[int]) -> Problem:
        from drpbench.generation.training_problems import FAMILY_NAMES

        drawn = [self._unobstructed(id) for id in ids]
        goal = np.stack([one.goal for one in drawn])
        position, quaternion = goal_poses(self._robot, goal)
        bare, elsewhere = self._task.training_levels
        turns = [bare if FAMILY_NAMES[one.family] == "table" else elsewhere for one in drawn]
        level = [levels[id % len(levels)] for id, levels in zip(ids, turns, strict=True)]
        return Problem(
            id=np.asarray(ids, np.int32),
            level=np.array(level, np.int32),
            start=goal if self._task.stays else np.stack([one.start for one in drawn]),
            goal=goal,
            goal_position=position,
            goal_quaternion=quaternion,
            obstacles=stacked([one.obstacles for one in drawn]).primitives(),
        )

    def _unobstructed(self, id: int) -> Any:  # Drawn, which is heavy to import
        while (drawn := self._drawer.draw(id)).obstructed:
            id = (id + 1) % _MOST
        return drawn


SOURCES = ("frozen", "training")
"""Problems that have a name: the benchmark's, and those to learn from."""


def source(problems: str | ProblemSet, task: Task) -> Problems:
    """Problems of a task by one of the SOURCES, or those of a set. Raises ValueError for another name."""
    if isinstance(problems, ProblemSet):
        require_runnable(problems, [task.name])
        return Frozen(task, problems)
    if problems not in SOURCES:
        raise ValueError(f"problems={problems!r}: there are: {', '.join(SOURCES)}")
    return Training(task) if problems == "training" else Frozen(task, load_set())
