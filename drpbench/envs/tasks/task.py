"""What a task is: how its moving obstacles are born, move and vanish."""

from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import jax
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray

from drpbench.contract import Movers, Problem


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Arm:
    """What a task may know of the arm: collision spheres (link0 left out) and the frame `grip`."""

    centers: Float[Array, "*batch S 3"]
    radii: Float[Array, "*batch S"]
    grip_position: Float[Array, "*batch 3"]


@runtime_checkable
class Task(Protocol):
    """A task, as pure functions for one world. `memory` is whatever pytree the task needs.

    The control step `clock` is one number for all worlds of a batch, and no part of their state: an
    event at a fixed time then stays a branch under `vmap`, and costs nothing in other steps.
    """

    name: str
    title: str
    movers: int
    """How many moving boxes there can be."""
    rehearsed: bool
    """Whether a first pass records the policy's path, and `second_pass` starts the one that counts."""
    stays: bool
    """Whether the arm starts at its goal, and has to come back to it."""
    conditional: bool
    """Whether an episode may turn out to be no instance of the task, see `valid`."""
    training_levels: tuple[tuple[int, ...], tuple[int, ...]]
    """Levels of problems drawn to learn from, on the bare table and elsewhere; each is taken in turn."""

    def reset(self, problem: Problem, arm: Arm, key: PRNGKeyArray) -> tuple[Movers, Any]:
        """The boxes before the first control step."""
        ...

    def advance(
        self, movers: Movers, memory: Any, problem: Problem, arm: Arm, clock: Int[Array, ""]
    ) -> tuple[Movers, Any]:
        """The boxes during control step `clock`, from those of the step before."""
        ...

    def valid(self, memory: Any) -> Bool[Array, ""]:
        """Whether the episode was an instance of the task at all (see GB)."""
        ...
