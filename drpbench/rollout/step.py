"""One control step of one world: the policy acts, the world follows, and a record is kept.

Whatever runs an episode is made of these pure functions, vmapped over worlds or not: the batch
(`batch.py`), policies outside jit (`host.py`), `drpbench.gym` and `drpbench.viewer`. `world` and
`seed` are static. The corrections of `drpbench.learning` share none of it: they have no dynamics
and no moving boxes, and their point clouds and keys come from the demonstrations' own streams.
"""

from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from drpbench.contract import Observation, Policy, Problem
from drpbench.envs import State, World
from drpbench.geometry import quaternion_to_matrix, rotation_angle

from .keys import POLICY, WORLD, instance_key


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Record:
    """What is kept of a world after a control step, M moving boxes in it.

    In the order of the alphabet: XLA rounds as the order of a program's results will have it, and
    shipped rows are of this one.
    """

    clearance: Float[Array, "*batch"]
    """[m] smallest signed distance of arm and obstacles during the step."""
    finite: Bool[Array, "*batch"]
    """Whether the target and the state are numbers."""
    grip_position: Float[Array, "*batch 3"]
    joint_position: Float[Array, "*batch J"]
    joint_velocity: Float[Array, "*batch J"]
    mover_active: Bool[Array, "*batch M"]
    mover_half_size: Float[Array, "*batch M 3"]
    mover_position: Float[Array, "*batch M 3"]
    mover_rotation: Float[Array, "*batch M 3 3"]
    orientation_error: Float[Array, "*batch"]
    """[rad] of `grip` from the goal."""
    position_error: Float[Array, "*batch"]
    """[m]"""
    self_clearance: Float[Array, "*batch"]
    """[m] smallest distance between links that can touch."""
    sphere: Int[Array, "*batch"]
    """The sphere that `clearance` belongs to, as an index into `moving_spheres`."""


def reset(world: World, seed: int, problem: Problem, stream: int = WORLD) -> State:
    """The world of an instance before its first control step."""
    return world.reset(problem, instance_key(seed, world.task.name, problem.id, stream))


def begin(
    world: World, policy: Policy, seed: int, problem: Problem
) -> tuple[State, Any, Observation]:
    """An episode's beginning: the state, what the policy carries, and what it saw."""
    state = reset(world, seed, problem)
    observation = world.observe(state, policy.privileged)
    return state, policy.init(observation), observation


def act(
    world: World, policy: Policy, seed: int, state: State, carry: Any, clock: Int[Array, ""]
) -> tuple[Any, Any]:
    """What the policy says to what it sees of the state, and its new carry."""
    key = instance_key(seed, world.task.name, state.problem.id, POLICY)
    observation = world.observe(state, policy.privileged)
    return policy.act(observation, carry, jax.random.fold_in(key, clock))


def apply(
    world: World, state: State, target: Float[Array, " J"], clock: Int[Array, ""]
) -> tuple[State, Record]:
    """The world one control step later, on its way to the target [rad], and the record of it."""
    state, events = world.step(state, target, clock)
    problem, movers = state.problem, state.movers
    goal_rotation = quaternion_to_matrix(jnp.asarray(problem.goal_quaternion))
    return state, Record(
        joint_position=state.joint_position,
        joint_velocity=state.joint_velocity,
        grip_position=events.grip_position,
        position_error=jnp.linalg.norm(events.grip_position - problem.goal_position),
        orientation_error=rotation_angle(events.grip_rotation, goal_rotation),
        clearance=events.clearance,
        sphere=events.sphere,
        self_clearance=events.self_clearance,
        finite=events.finite,
        mover_position=movers.position,
        mover_active=movers.active,
        mover_half_size=movers.half_size,
        mover_rotation=movers.rotation,
    )


def step(
    world: World, policy: Policy, seed: int, state: State, carry: Any, clock: Int[Array, ""]
) -> tuple[State, Any, Record]:
    """One control step: `act`, then `apply`."""
    target, carry = act(world, policy, seed, state, carry, clock)
    state, record = apply(world, state, target, clock)
    return state, carry, record
