"""DGB, dynamic goal blocking: the arm is at its goal, and boxes come for it.

The start is the goal configuration: the arm has to give way and come back. Birth: in the upper half
of a shell of 0.5 to 0.6 m about the goal, at x >= 0.15 m, clear of the arm by 1 cm; one box, three
on level 2. Motion: as in FDO, headed for the goal but for N(0, 0.01); a box turns back 1.0 m from
the goal, at x = 0.15 m, 0.25 m from the base's axis up to 0.6 m of height, and before the core of
the first link, which no policy can move aside. Removal: 300 steps before the end.
"""

from dataclasses import dataclass, replace

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray

from drpbench.contract import Episode, Movers, Problem

from ..arm import Arm
from ..movers import drift, drifting_box, in_upper_shell
from .task import Task

_COLUMN = 0.25  # [m] about the base's axis


def _excess(position: Float[Array, "*boxes 3"], goal: Float[Array, "3"]) -> Float[Array, "*boxes"]:
    """How far [m] a box's centre is outside the region it may drift in."""
    from_goal = jnp.linalg.norm(position - goal, axis=-1) - 1.0
    into_column = _COLUMN - jnp.linalg.norm(position[..., :2], axis=-1)
    into_column = jnp.minimum(into_column, 0.6 - position[..., 2])
    return jnp.maximum(jnp.maximum(from_goal, into_column), 0.15 - position[..., 0])


@dataclass(frozen=True)
class DynamicGoalBlocking(Task):
    name: str = "DGB"
    title: str = "dynamic goal blocking"
    movers: int = 3
    removal: int = 300  # control steps at 60 Hz before the end
    starts_at_goal: bool = True
    conditional: bool = False

    def reset(
        self, problem: Problem, arm: Arm, key: PRNGKeyArray, episode: Episode
    ) -> tuple[Movers, tuple[()]]:
        goal = jnp.asarray(problem.goal_position)

        def place(key: PRNGKeyArray) -> Float[Array, "3"]:
            return in_upper_shell(key, goal, 0.5, 0.6)

        def excess(position: Float[Array, "3"]) -> Float[Array, ""]:
            return _excess(position, goal)

        def born(key: PRNGKeyArray) -> Movers:
            return drifting_box(key, 0.3, place, excess, goal, 0.01, arm, episode.pace)

        movers = jax.vmap(born)(jax.random.split(key, self.movers))
        boxes = jnp.where(problem.level == 2, 3, 1)
        return replace(movers, active=jnp.arange(self.movers) < boxes), ()

    def advance(
        self,
        movers: Movers,
        memory: tuple[()],
        problem: Problem,
        arm: Arm,
        clock: Int[Array, ""],
        episode: Episode,
    ) -> tuple[Movers, tuple[()]]:
        goal = jnp.asarray(problem.goal_position)
        movers = drift(movers, lambda position: _excess(position, goal), arm.robot)
        removed = episode.steps - episode.lasting(self.removal)
        return replace(movers, active=movers.active & (clock < removed)), memory

    def training_level(
        self, number: Int[np.ndarray, " n"], furnished: Bool[np.ndarray, " n"]
    ) -> Int[np.ndarray, " n"]:
        return np.where(number % 4 == 3, 2, 1)
