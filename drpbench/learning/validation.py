"""How well a policy does while it learns: closed loop, on problems of a stream of their own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np

from drpbench.contract import Policy, Problem
from drpbench.envs import TASKS
from drpbench.evaluation.metrics import rows
from drpbench.generation.training_problems import VALIDATION_STREAM, Drawer, Drawn
from drpbench.geometry import Primitives, matrix_to_quaternion, quaternion_to_matrix
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
    """The first so many problems of the validation stream whose goals are free, as the static task."""

    def __init__(self, count: int = LANES, robot: Robot = PANDA):
        drawer, number = Drawer(VALIDATION_STREAM), 0
        drawn: list[Drawn] = []
        while len(drawn) < count:
            one = drawer.draw(number)
            drawn += [] if one.obstructed else [one]
            number += 1
        self._problems, self._count = problems(drawn, robot), count
        self._rollout: Rollout | None = None

    def score(self, policy: Policy) -> Score:
        """Episodes of the policy; later ones must be of the same structure."""
        if self._rollout is None:
            self._rollout = Rollout(TASKS["SE"], policy, lanes=max(LANES, self._count))
        self._rollout.policy = policy
        trace = self._rollout.run(self._problems)
        found = rows("SE", list(range(self._count)), ["validation"] * self._count, trace)
        return Score(
            self._count,
            sum(row.reached for row in found),
            sum(row.collided for row in found),
            sum(row.success for row in found),
        )


def problems(drawn: Sequence[Drawn], robot: Robot = PANDA) -> Problem:
    """Drawn problems as a batch for the world."""
    pose = jax.jit(lambda q: robot.grip_pose(robot.link_poses(q)))
    poses = [pose(one.goal) for one in drawn]
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
