"""Which problems an environment serves: the frozen ones by number, or training problems by number."""

from collections.abc import Sequence
from dataclasses import fields
from typing import Protocol

import jax
import jax.numpy as jnp
import numpy as np

from drpbench.contract import Problem
from drpbench.envs import Task
from drpbench.geometry import Primitives, matrix_to_quaternion, quaternion_to_matrix
from drpbench.problems import load
from drpbench.robot import PANDA
from drpbench.rollout.batch import take


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
    """The benchmark's problems, in a random order that comes to each of them before it begins again."""

    stream = 0  # as in `drpbench run`: the same boxes, the same points

    def __init__(self, task: Task):
        self._problems = load(task.name)
        self._left: list[int] = []

    def require(self, ids: Sequence[int]) -> None:
        count = self._problems.count
        for id in ids:
            if not 0 <= id < count:
                raise ValueError(
                    f"no problem {id} in {self._problems.task}; ids go from 0 to {count - 1}"
                )

    def draw(self, rng: np.random.Generator, count: int) -> list[int]:
        while len(self._left) < count:
            self._left += rng.permutation(self._problems.count).tolist()
        drawn, self._left = self._left[:count], self._left[count:]
        return drawn

    def restart(self) -> None:
        self._left = []

    def take(self, ids: Sequence[int]) -> Problem:
        return take(self._problems, ids)


_MOST = 2**31  # training problems there are numbers for


class Training:
    """Problems to learn from, drawn on the host from the stream of `drpbench data`.

    Those with a box on their goal are passed over for the next number that has none. DGB begins at the
    goal. A task's level, which sets number and size of its moving boxes, is 1 on the bare table and 2
    elsewhere; of DGB, every fourth problem has three boxes.
    """

    stream = 2  # no box and no point as in the benchmark

    def __init__(self, task: Task):
        # What draws problems is heavy to import, and of no use to who asks for the frozen ones.
        from drpbench.generation.training_problems import TRAINING_STREAM, Drawer

        self._task, self._drawer = task, Drawer(TRAINING_STREAM)

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
        stacked = {
            field.name: np.stack([getattr(one, field.name) for one in drawn])
            for field in fields(drawn[0])
        }
        goal = stacked["goal"]
        position, quaternion = (np.asarray(values) for values in _goal_pose(jnp.asarray(goal)))
        if self._task.name == "DGB":
            level = np.where(np.asarray(ids) % 4 == 3, 2, 1)
        else:
            level = np.array([1 if FAMILY_NAMES[one.family] == "table" else 2 for one in drawn])
        rotation = quaternion_to_matrix(jnp.asarray(stacked["quaternion"]))
        return Problem(
            id=np.asarray(ids, np.int32),
            level=level.astype(np.int32),
            start=goal if self._task.name == "DGB" else stacked["start"],
            goal=goal,
            goal_position=position,
            goal_quaternion=quaternion,
            obstacles=Primitives(
                kind=stacked["kind"],
                half_size=stacked["half_size"],
                position=stacked["position"],
                rotation=np.asarray(rotation),
                mask=stacked["mask"],
            ),
        )

    def _unobstructed(self, id: int):
        while (drawn := self._drawer.draw(id)).obstructed:
            id = (id + 1) % _MOST
        return drawn


def _goal_pose(goal: jax.Array) -> tuple[jax.Array, jax.Array]:
    """Position [m] and quaternion wxyz of `grip` for goals (n, 7)."""
    position, rotation = jax.vmap(lambda q: PANDA.grip_pose(PANDA.link_poses(q)))(goal)
    return position, matrix_to_quaternion(rotation)


SOURCES: dict[str, type[Frozen] | type[Training]] = {"frozen": Frozen, "training": Training}
