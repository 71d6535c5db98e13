"""How well a policy does while it learns: closed loop, on problems of a stream of their own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from drpbench.contract import Policy, Problem
from drpbench.envs import TASKS, World
from drpbench.generation.training_problems import VALIDATION_STREAM, Drawer, Drawn
from drpbench.geometry import stacked
from drpbench.problems import goal_poses
from drpbench.robot import PANDA, Robot
from drpbench.rollout import LANES, Rollout


@dataclass(frozen=True)
class Score:
    """Of `validated` episodes: reached the goal, touched something, reached without touching."""

    validated: int
    reached: int
    collided: int
    succeeded: int


class Validation:
    """The first so many problems of the validation stream whose goals are free, as the static
    task."""

    def __init__(self, count: int = LANES, robot: Robot = PANDA):
        drawer, number = Drawer(VALIDATION_STREAM, robot), 0
        drawn: list[Drawn] = []
        while len(drawn) < count:
            one = drawer.draw(number)
            drawn += [] if one.obstructed else [one]
            number += 1
        self._problems, self._count = problems(drawn, robot), count
        self._world = World(TASKS["SE"], robot)

    def score(self, policy: Policy) -> Score:
        """Episodes of the policy. Nothing is compiled for one of the structure of an earlier
        one."""
        rollout = Rollout(self._world, policy, lanes=max(LANES, self._count))
        verdict = rollout.run(self._problems).verdict
        return Score(
            self._count,
            int(verdict.reached.sum()),
            int(verdict.collided.sum()),
            int(verdict.success.sum()),
        )


def problems(drawn: Sequence[Drawn], robot: Robot = PANDA) -> Problem:
    """Drawn problems as a batch for the world."""
    goal = np.stack([one.goal for one in drawn])
    position, quaternion = goal_poses(robot, goal)
    return Problem(
        id=np.array([one.index for one in drawn], np.int32),
        level=np.zeros(len(drawn), np.int32),
        start=np.stack([one.start for one in drawn]),
        goal=goal,
        goal_position=position,
        goal_quaternion=quaternion,
        obstacles=stacked([one.obstacles for one in drawn]).primitives(),
    )
