"""Which problems an environment serves: the frozen ones by number, or training problems by
number."""

from collections.abc import Sequence
from functools import lru_cache
from typing import Any, Protocol, runtime_checkable

import numpy as np

from drpbench.contract import Problem
from drpbench.envs import World
from drpbench.geometry import stacked
from drpbench.problems import ProblemSet, goal_poses, load_set
from drpbench.rollout.keys import WORLD


@runtime_checkable
class Problems(Protocol):
    """Numbered problems of one task."""

    stream: int
    """The random stream of their worlds, see `drpbench.rollout.instance_key`."""

    def require(self, ids: Sequence[int]) -> None:
        """Raises ValueError for a number that there is not."""

    def draw(self, rng: np.random.Generator, count: int) -> list[int]:
        """The next `count` numbers."""

    def restart(self) -> None:
        """Forgets what was drawn."""

    def take(self, ids: Sequence[int]) -> Problem:
        """The numbered problems as a batch."""


class Frozen:
    """The problems of a set, in a random order that comes to each of them before it begins
    again."""

    stream = WORLD  # as in `drpbench run`: the same boxes, the same points

    def __init__(self, world: World, problem_set: ProblemSet):
        self._problems = problem_set.task(world.task.name)
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
_KEPT = 8192  # training problems that a process keeps once drawn, some kB each


class Training:
    """Problems to learn from, drawn on the host from the stream of `drpbench data`, of the scene
    families that the benchmark's problems of the task have.

    Those with a box on their goal are passed over for the next number that has none. Where they
    begin, and on which level, the task says (`Task.starts_at_goal`, `Task.training_level`).
    """

    stream = 2  # no box and no point as in the benchmark

    def __init__(self, world: World, numbers: range = range(_MOST)):
        # What draws problems is heavy to import, and of no use to who asks for the frozen ones.
        from drpbench.generation.training_problems import TRAINING_STREAM, Drawer

        families = sorted(set(load_set().task(world.task.name).family))
        self._world, self._drawer = world, Drawer(TRAINING_STREAM, families=families)
        self._numbers, self._kept = numbers, lru_cache(_KEPT)(self._unobstructed)

    def require(self, ids: Sequence[int]) -> None:
        for id in ids:
            if id not in self._numbers:
                first, last = self._numbers[0], self._numbers[-1]
                raise ValueError(f"no training problem {id}; ids go from {first} to {last}")

    def draw(self, rng: np.random.Generator, count: int) -> list[int]:
        return [self._numbers[n] for n in rng.integers(len(self._numbers), size=count).tolist()]

    def restart(self) -> None:
        pass

    def take(self, ids: Sequence[int]) -> Problem:
        from drpbench.generation.training_problems import FAMILY_NAMES

        drawn = [self._kept(id) for id in ids]
        goal = np.stack([one.goal for one in drawn])
        position, quaternion = goal_poses(self._world.robot, goal)
        task = self._world.task
        furnished = np.array([FAMILY_NAMES[one.family] != "table" for one in drawn])
        level = task.training_level(np.asarray(ids), furnished)
        return Problem(
            id=np.asarray(ids, np.int32),
            level=level.astype(np.int32),
            start=goal if task.starts_at_goal else np.stack([one.start for one in drawn]),
            goal=goal,
            goal_position=position,
            goal_quaternion=quaternion,
            obstacles=stacked([one.obstacles for one in drawn]).primitives(),
            witness=np.stack([one.hint for one in drawn]),
        )

    def _unobstructed(self, id: int) -> Any:  # Drawn, which is heavy to import
        while (drawn := self._drawer.draw(id)).obstructed:
            id = (id + 1) % _MOST
        return drawn


SOURCES = ("frozen", "training")
"""Problems that have a name: the benchmark's, and those to learn from."""


def source(problems: str | range | ProblemSet, world: World) -> Problems:
    """Problems of a world's task by one of the SOURCES, those of a set, or a range of the numbers
    of training problems.

    Raises ValueError for another name, and for a range of none or beyond those numbers.
    """
    if isinstance(problems, ProblemSet):
        return Frozen(world, problems)
    if isinstance(problems, range):
        if not problems or min(problems) < 0 or max(problems) >= _MOST:
            raise ValueError(f"problems={problems!r}: expected numbers from 0 to {_MOST - 1}")
        return Training(world, problems)
    if problems not in SOURCES:
        raise ValueError(f"problems={problems!r}: there are: {', '.join(SOURCES)}")
    return Training(world) if problems == "training" else Frozen(world, load_set())
