"""How well a policy does while it learns: closed loop, on problems of a stream of their own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np

from drpbench.contract import Policy, Problem
from drpbench.envs import TASKS, World
from drpbench.generation.training_problems import VALIDATION_STREAM, Drawer, Drawn
from drpbench.geometry import Primitives, matrix_to_quaternion, quaternion_to_matrix
from drpbench.robot import PANDA
from drpbench.rollout import LANES, Rollout


@dataclass(frozen=True)
class Score:
    """Of `validated` episodes: reached the goal, touched something, reached without touching."""

    validated: int
    reached: int
    collided: int
    succeeded: int


class Validation:
    """The first so many problems of the validation stream whose goals are free, as the static task."""

    def __init__(self, count: int = LANES):
        drawer, drawn, number = Drawer(VALIDATION_STREAM), [], 0
        while len(drawn) < count:
            one = drawer.draw(number)
            drawn += [] if one.obstructed else [one]
            number += 1
        self._problems, self._count = problems(drawn), count

    def score(self, policy: Policy) -> Score:
        """Episodes of the policy. Nothing is compiled for one of the structure of an earlier one."""
        rollout = Rollout(World(TASKS["SE"]), policy, lanes=max(LANES, self._count))
        verdict = rollout.run(self._problems).verdict
        return Score(
            self._count,
            int(verdict.reached.sum()),
            int(verdict.collided.sum()),
            int(verdict.success.sum()),
        )


_pose = jax.jit(lambda q: PANDA.grip_pose(PANDA.link_poses(q)))


def problems(drawn: Sequence[Drawn]) -> Problem:
    """Drawn problems as a batch for the world."""
    poses = [_pose(one.goal) for one in drawn]
    quaternions = jnp.stack([one.quaternion for one in drawn])
    return Problem(
        id=np.array([one.index for one in drawn], np.int32),
        level=np.zeros(len(drawn), np.int32),
        start=np.stack([one.start for one in drawn]),
        goal=np.stack([one.goal for one in drawn]),
        goal_position=np.stack([position for position, _ in poses]),
        goal_quaternion=np.stack([matrix_to_quaternion(rotation) for _, rotation in poses]),
        obstacles=Primitives(
            kind=np.stack([one.kind for one in drawn]),
            half_size=np.stack([one.half_size for one in drawn]),
            position=np.stack([one.position for one in drawn]),
            rotation=np.asarray(quaternion_to_matrix(quaternions)),
            mask=np.stack([one.mask for one in drawn]),
        ),
    )
