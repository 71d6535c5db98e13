"""Episodes of a policy in a world, many problems at once."""

from dataclasses import dataclass, fields, replace
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from drpbench.compile import jit
from drpbench.contract import Policy, Problem, Verdict
from drpbench.envs import State, World
from drpbench.plugins.host import Hosted

from . import step as one_world
from .host import Advanced, Answers, host_pass
from .step import Record

LANES = 64
"""Smallest compiled batch. XLA's rounding depends on shapes, so smaller batches are padded to it.
"""
CHUNK = 100  # control steps a call


def silent(steps: int) -> None:
    """Tells nobody."""


@dataclass(frozen=True)
class Trace:
    """What an episode's metrics are made of: T control steps, B problems, an arm of J joints, M
    moving boxes."""

    world: World
    """Where it happened."""
    joint_position: np.ndarray  # (T, B, J) [rad]
    joint_velocity: np.ndarray  # (T, B, J) [rad/s]
    grip_position: np.ndarray  # (T, B, 3) [m]
    position_error: np.ndarray  # (T, B) [m], grip to goal
    orientation_error: np.ndarray  # (T, B) [rad]
    clearance: np.ndarray  # (T, B) [m]
    sphere: np.ndarray  # (T, B) index into moving_spheres
    self_clearance: np.ndarray  # (T, B) [m]
    finite: np.ndarray  # (T, B) bool
    mover_position: np.ndarray  # (T, B, M, 3) [m]
    mover_active: np.ndarray  # (T, B, M) bool
    mover_half_size: np.ndarray  # (T, B, M, 3) [m]; SAO puts boxes of several sizes
    mover_rotation: np.ndarray  # (T, B, M, 3, 3)
    start: np.ndarray  # (B, J) [rad]
    start_grip: np.ndarray  # (B, 3) [m]
    valid: np.ndarray  # (B,) bool
    failures: tuple[str, ...]  # (B,) why the policy gave no answer, or gave up; "" if it did not

    @property
    def verdict(self) -> Verdict:
        """(B,) Of the whole episodes; none is finite where the policy failed."""
        answered = self.finite & ~np.array([bool(one) for one in self.failures])
        return Verdict.of(replace(self, finite=answered), self.valid)


class Rollout:
    """A policy, in JAX or outside it, in a world: batches of one compiled size.

    Rollouts share their compiled programs where their worlds are equal and their policies differ in
    parameters only. A policy outside jit sees the real instances alone. Where it fails, its arms
    stop where they are, the episode goes on without it, and the trace says why in `failures`.
    """

    def __init__(self, world: World, policy: Policy | Hosted, seed: int = 0, lanes: int = LANES):
        self.world, self.policy, self.seed, self.lanes = world, policy, seed, lanes

    def run(self, problems: Problem, advanced: Advanced = silent) -> Trace:
        """Every problem's episode, once. `advanced` is told of every few control steps done.

        Raises ValueError where there is no problem, or more of them than lanes.
        """
        count = len(problems.id)
        if not 0 < count <= self.lanes:
            raise ValueError(f"{count} problems for {self.lanes} lanes")
        filled = np.arange(self.lanes) % count
        batch = jax.tree.map(lambda leaf: jnp.asarray(np.asarray(leaf)[filled]), problems)
        policy = self.policy
        answers = Answers(policy, count) if isinstance(policy, Hosted) else None
        inside = policy.shown if isinstance(policy, Hosted) else policy
        first, carry, start_grip = begin(self.world, inside, self.seed, batch)

        if answers is None:
            records, last = device_pass(self.world, inside, self.seed, first, carry, advanced)
        else:
            records, last = host_pass(self.world, answers, self.seed, first, carry, advanced)
        valid = jax.vmap(self.world.task.valid)
        return Trace(
            world=self.world,
            **{of.name: getattr(records, of.name)[:, :count] for of in fields(Record)},
            start=np.asarray(problems.start),
            start_grip=np.asarray(start_grip)[:count],
            valid=np.asarray(valid(last.memory))[:count]
            if jax.tree.leaves(last.memory)
            else np.ones(count, bool),
            failures=answers.failures if answers else ("",) * count,
        )


def device_pass(
    world: World, policy: Policy, seed: int, state: State, carry: Any, advanced: Advanced
) -> tuple[Record, State]:
    """Every step of an episode from its first state: the records, time first, and the last
    state."""
    chunks, steps = [], world.episode.steps
    for first in range(0, steps, CHUNK):
        clocks = jnp.arange(first, min(first + CHUNK, steps), dtype=jnp.int32)
        state, carry, records = advance(world, policy, seed, state, carry, clocks)
        chunks.append(jax.tree.map(np.asarray, records))
        advanced(len(clocks))
    return jax.tree.map(lambda *parts: np.concatenate(parts), *chunks), state


@partial(jit, static_argnums=(0, 2))
def begin(
    world: World, policy: Policy, seed: int, problems: Problem
) -> tuple[State, Any, jax.Array]:
    """Episodes' beginnings: states, what the policy carries, and where `grip` is [m]."""

    def one(problem: Problem) -> tuple[State, Any, jax.Array]:
        state, carry, _ = one_world.begin(world, policy, seed, problem)
        poses = world.robot.link_poses(state.joint_position)
        return state, carry, world.robot.grip_pose(poses)[0]

    return jax.vmap(one)(problems)


@partial(jit, static_argnums=(0, 2))
def advance(
    world: World, policy: Policy, seed: int, state: State, carry: Any, clocks: jax.Array
) -> tuple[State, Any, Record]:
    """The worlds after the control steps `clocks`, with the records of each, time first."""
    one = partial(one_world.step, world, policy, seed)

    def step(worlds: tuple[State, Any], clock: jax.Array) -> tuple[tuple[State, Any], Record]:
        state, carry, record = jax.vmap(one, in_axes=(0, 0, None))(*worlds, clock)
        return (state, carry), record

    (state, carry), records = jax.lax.scan(step, (state, carry), clocks)
    return state, carry, records
