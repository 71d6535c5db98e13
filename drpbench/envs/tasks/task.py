"""What a task is: how its moving obstacles are born, move and vanish."""

from typing import Any, Protocol, runtime_checkable

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Int, PRNGKeyArray

from drpbench.contract import Episode, Movers, Problem

from ..arm import Arm


@runtime_checkable
class Task(Protocol):
    """A task, as pure functions for one world. `memory` is whatever pytree the task needs.

    The control step `clock` is one number for all worlds of a batch, and no part of their state: an
    event at a fixed time then stays a branch under `vmap`, and costs nothing in other steps. Times
    that the tasks' descriptions give in control steps, and speeds a control step, are those at 60
    Hz; at another rate they last as long and are as fast (`Episode.lasting`, `Episode.pace`).
    A class that inherits from this one has `valid` and `training_level` as they stand here.
    """

    @property
    def name(self) -> str: ...

    @property
    def conditional(self) -> bool:
        """Whether an episode may turn out to be no instance of the task, see `valid`."""
        ...

    @property
    def starts_at_goal(self) -> bool:
        """Whether the arm begins at its goal."""
        ...

    @property
    def title(self) -> str: ...

    @property
    def movers(self) -> int:
        """How many moving boxes there can be."""
        ...

    @property
    def removal(self) -> int:
        """How many control steps before the end, at 60 Hz, the boxes vanish; 0 where there are
        none."""
        ...

    def reset(
        self, problem: Problem, arm: Arm, key: PRNGKeyArray, episode: Episode
    ) -> tuple[Movers, Any]:
        """The boxes before the first control step."""
        ...

    def advance(
        self,
        movers: Movers,
        memory: Any,
        problem: Problem,
        arm: Arm,
        clock: Int[Array, ""],
        episode: Episode,
    ) -> tuple[Movers, Any]:
        """The boxes during control step `clock`, from those of the step before."""
        ...

    def valid(self, memory: Any) -> Bool[Array, ""]:
        """Whether the episode was an instance of the task at all (see GB)."""
        return jnp.bool_(True)

    def training_level(
        self, number: Int[np.ndarray, " n"], furnished: Bool[np.ndarray, " n"]
    ) -> Int[np.ndarray, " n"]:
        """The levels of problems to learn from, by their numbers and by whether more than the bare
        table stands in their scenes. A level sets how many boxes move and how large they are."""
        return np.where(furnished, 2, 1)
