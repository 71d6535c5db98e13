"""Episodes of a host policy: the world compiled step by step, the policy asked in between."""

from collections.abc import Callable
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from drpbench.compile import jit
from drpbench.contract import Observation, Policy
from drpbench.envs import State, World
from drpbench.plugins.host import Failed, Hosted

from . import step as one_world
from .step import Record

Advanced = Callable[[int], None]
"""Is told of every few control steps done."""
_TOLD = 20  # control steps between two signs of progress


class Answers:
    """What a host policy answers in one run of `count` instances. Once it has failed it is not
    asked again."""

    def __init__(self, policy: Hosted, count: int):
        self.policy, self.count = policy, count
        self.failure = ""
        """Why it failed."""

    def reset(self, observation: Observation) -> None:
        """Episodes begin. Raises PolicyError where a policy that hung cannot be made anew."""
        self._ask(self.policy.reset, observation)

    def act(self, observation: Observation, joints: int) -> np.ndarray:
        """Targets for every lane [rad], the instances again and again. Where there is none it is
        not a number, which the world counts as failed."""
        lanes = len(observation.joint_position)
        targets = self._ask(self.policy.act, observation)
        if targets is None:
            return np.full((lanes, joints), np.nan, np.float32)
        return targets[np.arange(lanes) % self.count]

    @property
    def failures(self) -> tuple[str, ...]:
        """(count,) Why each episode has no answers, or was given up; "" where it was not."""
        if not self.failure:
            try:
                return self.policy.failures(self.count)
            except Failed as failed:
                self.failure = str(failed)
        return (self.failure,) * self.count

    def _ask(
        self, question: Callable[[Observation, int], Any], observation: Observation
    ) -> np.ndarray | None:
        if not self.failure:
            try:
                return question(observation, self.count)
            except Failed as failed:
                self.failure = str(failed)
        return None


def host_pass(
    world: World, answers: Answers, seed: int, state: State, carry: Any, advanced: Advanced
) -> tuple[Record, State]:
    """As `device_pass`, with a policy outside jit: `carry` is that of what lies over it."""
    shown, joints = answers.policy.shown, world.robot.joints
    answers.reset(see(world, shown.privileged, state))
    records: list[Any] = []
    for begin in range(0, world.episode.steps, _TOLD):
        chunk = []
        for clock in range(begin, min(begin + _TOLD, world.episode.steps)):
            now = np.int32(clock)
            seen, carry = show(world, shown, seed, state, carry, now)
            state, record = apply(world, state, answers.act(seen, joints), now)
            chunk.append(record)
        records += jax.device_get(chunk)
        advanced(len(chunk))
    return jax.tree.map(lambda *parts: np.stack(parts), *records), state


@partial(jit, static_argnums=(0, 1))
def see(world: World, privileged: bool, state: State) -> Observation:
    """What a batch of worlds shows, in memory of its own: what is handed out may be written on."""
    seen = jax.vmap(lambda state: world.observe(state, privileged))(state)
    return jax.tree.map(jnp.copy, seen)


@partial(jit, static_argnums=(0, 2))
def show(
    world: World, policy: Policy, seed: int, state: State, carry: Any, clock: jax.Array
) -> tuple[Observation, Any]:
    """The same as what lies over the host policy makes of it, and what that carries."""
    one = partial(one_world.act, world, policy, seed)
    seen, carry = jax.vmap(one, in_axes=(0, 0, None))(state, carry, clock)
    # A copy: what jit returns unchanged would be the world's own memory.
    return jax.tree.map(jnp.copy, seen), carry


@partial(jit, static_argnums=0)
def apply(world: World, state: State, targets: jax.Array, clock: jax.Array) -> tuple[State, Record]:
    """A batch of worlds one control step later."""
    one = partial(one_world.apply, world)
    return jax.vmap(one, in_axes=(0, 0, None))(state, targets, clock)
