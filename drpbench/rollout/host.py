"""Episodes of a host policy: the world compiled step by step, the policy asked in between."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from drpbench.compile import jit
from drpbench.contract import CONTROL_STEPS, Observation, Policy, Problem
from drpbench.envs import State, Task
from drpbench.plugins.host import Failed, Hosted

from .batch import LANES, Rollout, Trace, instance_key, record

_TOLD = 20  # control steps between two signs of progress


class HostRollout(Rollout):
    """A host policy and a task. The policy sees the real instances, the world has `lanes` of them.

    Where the policy fails, its arms stop where they are, the episode goes on without it, and the trace
    says why in `failure`.
    """

    def __init__(self, task: Task, policy: Hosted, seed: int = 0, lanes: int = LANES):
        super().__init__(task, policy.shown, seed, lanes)
        self.hosted = policy
        self._show, self._step = jit(self._show_batch), jit(self._step_batch)

    def run(self, problems: Problem, advanced: Callable[[int], None] = lambda steps: None) -> Trace:
        self._count, self._failure = len(problems.id), ""
        trace = super().run(problems, advanced)
        return replace(trace, failure=self._failure)

    def _episode(self, state: State, carry: Any, advanced: Callable[[int], None]) -> dict[str, Any]:
        carry, first = carry
        # What is handed out may be written on, and a second pass begins with the same.
        self._ask(self.hosted.reset, jax.tree.map(jnp.copy, first))
        chunks = []
        for begin in range(0, CONTROL_STEPS, _TOLD):
            chunk = []
            for clock in range(begin, min(begin + _TOLD, CONTROL_STEPS)):
                now = np.int32(clock)
                seen, carry = self._show(self.policy, state, carry, now)
                targets = self._ask(self.hosted.act, seen)
                state, step = self._step(state, self._filled(targets), now)
                chunk.append(step)
            chunks += jax.device_get(chunk)
            advanced(len(chunk))
        joined = {name: np.stack([step[name] for step in chunks]) for name in chunks[0]}
        return joined | {"state": state}

    def _ask(self, question: Callable, observation: Observation) -> np.ndarray | None:
        """The policy's answer; None once it has failed in this batch."""
        if not self._failure:
            try:
                return question(observation, self._count)
            except Failed as failed:
                self._failure = str(failed)
        return None

    def _filled(self, targets: np.ndarray | None) -> np.ndarray:
        """Targets for every lane; not a number where there is none, which the world counts as failed."""
        if targets is None:
            return np.full((self.lanes, 7), np.nan, np.float32)
        return targets[np.arange(self.lanes) % self._count]

    def _reset_batch(self, policy: Policy, problems: Problem):
        state, carry, start_grip = super()._reset_batch(policy, problems)
        first = jax.vmap(lambda state: self.world.observe(state, policy.privileged))(state)
        return state, (carry, first), start_grip

    def _show_batch(self, policy: Policy, state: State, carry: Any, clock: jax.Array):
        def one(state, carry):
            key = instance_key(self.seed, self.world.task.name, state.problem.id, 1)
            observation = self.world.observe(state, policy.privileged)
            return policy.act(observation, carry, jax.random.fold_in(key, clock))

        seen, carry = jax.vmap(one)(state, carry)
        # A copy: what jit returns unchanged would be the world's own memory, open to the policy's pen.
        return jax.tree.map(jnp.copy, seen), carry

    def _step_batch(self, state: State, targets: jax.Array, clock: jax.Array):
        state, events = jax.vmap(self.world.step, in_axes=(0, 0, None))(state, targets, clock)
        return state, jax.vmap(record)(state, events)


def rollout_of(task: Task, policy: Policy | Hosted, seed: int = 0, lanes: int = LANES) -> Rollout:
    """The rollout that a policy as `choose` gives it needs: inside jit, or step by step."""
    kind = HostRollout if isinstance(policy, Hosted) else Rollout
    return kind(task, policy, seed, lanes)
