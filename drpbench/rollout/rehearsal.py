"""An episode in its passes: where the task has a rehearsal (SAO), that comes before the one that
counts.

The rehearsal records where the policy takes `grip`; the pass that counts begins from the same
state, but for what the task makes of that path.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import cast

import jax
import jax.numpy as jnp
import numpy as np

from drpbench.envs import RehearsedTask, State, Task, World

from .step import Record


def passes(task: Task) -> int:
    """How often the steps of an episode are taken."""
    return 2 if task.rehearsed else 1


def second_pass(world: World, first: State, path: jax.Array | np.ndarray) -> State:
    """The state in which the pass that counts begins; `first` is the rehearsal's first.

    `path` (T, *worlds, 3) [m] is where `grip` was after each step of the rehearsal, of one world or
    of a batch of them.
    """
    path = jnp.asarray(path)
    prepare = cast(RehearsedTask, world.task).second_pass
    if path.ndim == 3:
        path, prepare = jnp.moveaxis(path, 0, 1), jax.vmap(prepare)
    return replace(first, memory=prepare(first.memory, path))


def in_passes(
    world: World, first: State, play: Callable[[State], tuple[Record, State]]
) -> tuple[Record, State]:
    """Plays every pass from its first state; the records of the one that counts, and its last
    state.

    `play` gives the records of all steps, time first, and the last state.
    """
    if world.task.rehearsed:
        rehearsal, _ = play(first)
        first = second_pass(world, first, rehearsal.grip_position)
    return play(first)


class Rehearsal:
    """The same for an episode that somebody else steps: tell it of every step while it is `on`."""

    def __init__(self, world: World, first: State):
        """`first` is the state before the first step."""
        self._world, self.first = world, first
        self.on = world.task.rehearsed
        """Whether the steps taken now are a rehearsal."""
        self._path: list[jax.Array | np.ndarray] = []

    def note(self, grip_position: jax.Array | np.ndarray) -> None:
        """Where `grip` [m] is after one step more."""
        if self.on:
            self._path.append(grip_position)

    def restart(self) -> None:
        """Forgets a rehearsal that was broken off; one that is over stays known."""
        if self.on:
            self._path = []

    def end(self) -> State:
        """Ends the rehearsal: the state in which the pass that counts begins, from now on
        `first`."""
        path = np.stack([np.asarray(place) for place in self._path])
        self.on, self.first = False, second_pass(self._world, self.first, path)
        return self.first
