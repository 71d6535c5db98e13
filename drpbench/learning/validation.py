"""How well a policy does while it learns: closed loop, on problems of a stream of their own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from drpbench.contract import Policy, Problem, Verdict
from drpbench.envs import TASKS, World
from drpbench.generation.training_problems import (
    ABROAD,
    AT_HOME,
    FAMILY_NAMES,
    VALIDATION_STREAM,
    Drawer,
    Drawn,
)
from drpbench.geometry import stacked
from drpbench.perception import SurfaceCloud
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
    task: of the benchmark's families (`AT_HOME`), or of scenes that nothing is learned from
    (`ABROAD`), as many of each of these."""

    def __init__(self, count: int = LANES, robot: Robot = PANDA, families: Sequence[str] = AT_HOME):
        drawn = _drawn(count, robot, families)
        self.families = [FAMILY_NAMES[one.family] for one in drawn]
        """Of each problem."""
        self._problems, self._count = problems(drawn, robot), count
        # Abroad there is no ground: what is below the base is seen.
        sensor = SurfaceCloud(ground=tuple(families) != ABROAD)
        self._world = World(TASKS["SE"], robot, sensor=sensor)

    def verdicts(self, policy: Policy) -> Verdict:
        """Of one episode a problem. Nothing is compiled for a policy of the structure of an earlier
        one."""
        rollout = Rollout(self._world, policy, lanes=max(LANES, self._count))
        return rollout.run(self._problems).verdict

    def score(self, policy: Policy) -> Score:
        """The verdicts, counted."""
        verdict = self.verdicts(policy)
        return Score(
            self._count,
            int(verdict.reached.sum()),
            int(verdict.collided.sum()),
            int(verdict.success.sum()),
        )


def _drawn(count: int, robot: Robot, families: Sequence[str]) -> list[Drawn]:
    """Problems of all families together as their stream has them, or of each in turn."""
    each = [(name,) for name in families] if tuple(families) == ABROAD else [tuple(families)]
    drawers = [Drawer(VALIDATION_STREAM, robot, names) for names in each]
    drawn: list[Drawn] = []
    number = 0
    while len(drawn) < count:
        one = drawers[number % len(drawers)].draw(number)
        drawn += [] if one.obstructed else [one]
        number += 1
    return drawn


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
