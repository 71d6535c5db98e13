"""Episodes on the device: a policy in a task's world, many problems at once."""

import zlib
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from drpbench.compile import jit
from drpbench.contract import CONTROL_STEPS, Policy, Problem
from drpbench.envs import Events, State, Task, World
from drpbench.geometry import quaternion_to_matrix, rotation_angle
from drpbench.robot import PANDA

LANES = 64
"""Smallest compiled batch. XLA's rounding depends on shapes, so smaller batches are padded to it."""
_CHUNK = 100  # control steps a call


@dataclass(frozen=True)
class Trace:
    """What an episode's metrics are made of: T control steps, B problems."""

    joint_position: np.ndarray  # (T, B, 7) [rad]
    joint_velocity: np.ndarray  # (T, B, 7) [rad/s]
    grip_position: np.ndarray  # (T, B, 3) [m]
    position_error: np.ndarray  # (T, B) [m], grip to goal
    orientation_error: np.ndarray  # (T, B) [rad]
    clearance: np.ndarray  # (T, B) [m]
    sphere: np.ndarray  # (T, B) index into moving_spheres()
    self_clearance: np.ndarray  # (T, B) [m]
    finite: np.ndarray  # (T, B) bool
    mover_position: np.ndarray  # (T, B, M, 3) [m]
    mover_active: np.ndarray  # (T, B, M) bool
    mover_half_size: np.ndarray  # (T, B, M, 3) [m]; SAO puts boxes of several sizes
    mover_rotation: np.ndarray  # (T, B, M, 3, 3)
    start: np.ndarray  # (B, 7) [rad]
    start_grip: np.ndarray  # (B, 3) [m]
    valid: np.ndarray  # (B,) bool
    failure: str = ""  # why the policy gave no answer in this batch, if it did not


def instance_key(seed: int, task: str, id: jax.Array, stream: int) -> jax.Array:
    """The random stream of one instance: 0 is the world's, 1 the policy's."""
    key = jax.random.fold_in(jax.random.key(seed), zlib.crc32(task.encode()) & 0x7FFFFFFF)
    return jax.random.fold_in(jax.random.fold_in(key, id), stream)


def record(state: State, events: Events) -> dict[str, jax.Array]:
    """What a trace keeps of one world after one control step."""
    problem = state.problem
    goal_rotation = quaternion_to_matrix(problem.goal_quaternion)
    return {
        "joint_position": state.joint_position,
        "joint_velocity": state.joint_velocity,
        "grip_position": events.grip_position,
        "position_error": jnp.linalg.norm(events.grip_position - problem.goal_position),
        "orientation_error": rotation_angle(events.grip_rotation, goal_rotation),
        "clearance": events.clearance,
        "sphere": events.sphere,
        "self_clearance": events.self_clearance,
        "finite": events.finite,
        "mover_position": state.movers.position,
        "mover_active": state.movers.active,
        "mover_half_size": state.movers.half_size,
        "mover_rotation": state.movers.rotation,
    }


class Rollout:
    """A policy and a task, compiled for batches of one fixed size."""

    def __init__(self, task: Task, policy: Policy, seed: int = 0, lanes: int = LANES):
        self.world, self.policy, self.seed, self.lanes = World(task), policy, seed, lanes
        self._reset = jit(self._reset_batch)
        self._advance = jit(self._advance_batch)

    def run(self, problems: Problem, advanced: Callable[[int], None] = lambda steps: None) -> Trace:
        """Every problem's episode, once. `advanced` is told of every few control steps done.

        Raises ValueError for more problems than lanes.
        """
        count = len(problems.id)
        if not 0 < count <= self.lanes:
            raise ValueError(f"{count} problems for {self.lanes} lanes")
        filled = np.arange(self.lanes) % count
        batch = jax.tree.map(lambda leaf: jnp.asarray(np.asarray(leaf)[filled]), problems)
        state, carry, start_grip = self._reset(self.policy, batch)
        if self.world.task.rehearsed:
            rehearsal = self._episode(state, carry, advanced)
            path = jnp.asarray(np.moveaxis(rehearsal["grip_position"], 0, 1))
            memory = jax.vmap(self.world.task.second_pass)(state.memory, path)
            state = replace(state, memory=memory)
        steps = self._episode(state, carry, advanced)
        last = steps.pop("state")
        return Trace(
            **{name: values[:, :count] for name, values in steps.items()},
            start=np.asarray(problems.start),
            start_grip=np.asarray(start_grip)[:count],
            valid=np.asarray(jax.vmap(self.world.task.valid)(last.memory))[:count]
            if jax.tree.leaves(last.memory)
            else np.ones(count, bool),
        )

    def _episode(self, state: State, carry: Any, advanced) -> dict[str, Any]:
        chunks = []
        for first in range(0, CONTROL_STEPS, _CHUNK):
            clocks = jnp.arange(first, first + _CHUNK, dtype=jnp.int32)
            state, carry, steps = self._advance(self.policy, state, carry, clocks)
            chunks.append(jax.tree.map(np.asarray, steps))
            advanced(_CHUNK)
        joined = {name: np.concatenate([chunk[name] for chunk in chunks]) for name in chunks[0]}
        return joined | {"state": state}

    def _reset_batch(self, policy: Policy, problems: Problem):
        def reset(problem):
            key = instance_key(self.seed, self.world.task.name, problem.id, 0)
            state = self.world.reset(problem, key)
            carry = policy.init(self.world.observe(state, policy.privileged))
            return state, carry, PANDA.grip_pose(PANDA.link_poses(state.joint_position))[0]

        return jax.vmap(reset)(problems)

    def _advance_batch(self, policy: Policy, state: State, carry: Any, clocks: jax.Array):
        def one(state, carry, clock):
            key = instance_key(self.seed, self.world.task.name, state.problem.id, 1)
            observation = self.world.observe(state, policy.privileged)
            target, carry = policy.act(observation, carry, jax.random.fold_in(key, clock))
            state, events = self.world.step(state, target, clock)
            return state, carry, record(state, events)

        def step(worlds, clock):
            state, carry, record = jax.vmap(one, in_axes=(0, 0, None))(*worlds, clock)
            return (state, carry), record

        (state, carry), records = jax.lax.scan(step, (state, carry), clocks)
        return state, carry, records
