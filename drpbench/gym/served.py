"""Which problems an environment serves: the frozen ones by number, or training problems by number."""

from collections.abc import Sequence
from dataclasses import fields
from typing import Protocol

import jax
import jax.numpy as jnp
import numpy as np

from drpbench.contract import Problem
from drpbench.envs import World
from drpbench.geometry import Primitives, matrix_to_quaternion, quaternion_to_matrix
from drpbench.problems import load
from drpbench.robot import Robot
from drpbench.rollout import take
from drpbench.rollout.keys import WORLD


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
    """The benchmark's problems, in a random order that comes to each of them before it begins again."""

    stream = WORLD  # as in `drpbench run`: the same boxes, the same points

    def __init__(self, world: World):
        self._problems = load(world.task.name)
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

    Those with a box on their goal are passed over for the next number that has none. Where they begin,
    and on which level, the task says (`Task.starts_at_goal`, `Task.training_level`).
    """

    stream = 2  # no box and no point as in the benchmark

    def __init__(self, world: World):
        # What draws problems is heavy to import, and of no use to who asks for the frozen ones.
        from drpbench.generation.training_problems import TRAINING_STREAM, Drawer

        self._world, self._drawer = world, Drawer(TRAINING_STREAM)

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
        position, quaternion = (
            np.asarray(values) for values in _goal_pose(self._world.robot, goal)
        )
        task = self._world.task
        furnished = np.array([FAMILY_NAMES[one.family] != "table" for one in drawn])
        level = task.training_level(np.asarray(ids), furnished)
        rotation = quaternion_to_matrix(jnp.asarray(stacked["quaternion"]))
        return Problem(
            id=np.asarray(ids, np.int32),
            level=level.astype(np.int32),
            start=goal if task.starts_at_goal else stacked["start"],
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


def _goal_pose(robot: Robot, goal: np.ndarray) -> tuple[jax.Array, jax.Array]:
    """Position [m] and quaternion wxyz of `grip` for goals (n, J)."""
    pose = jax.vmap(lambda q: robot.grip_pose(robot.link_poses(q)))
    position, rotation = pose(jnp.asarray(goal))
    return position, matrix_to_quaternion(rotation)


SOURCES: dict[str, type[Frozen] | type[Training]] = {"frozen": Frozen, "training": Training}
