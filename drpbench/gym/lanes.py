"""Episodes that a caller steps: one compiled program for all lanes, which share one clock.

An event at a fixed time then costs nothing in other steps (see `drpbench.envs.Task`), and every
lane's episode begins and ends with the others'.
"""

from dataclasses import dataclass
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from drpbench.compile import jit
from drpbench.contract import Observation, Problem, Verdict
from drpbench.envs import State, World
from drpbench.geometry import quaternion_to_matrix, rotation_angle
from drpbench.rollout import step as one_world


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Outcome:
    """Each lane after a control step; after the last one, the outcome of its episode."""

    clearance: Float[Array, "*lanes"]
    """Smallest signed distance [m] between arm and obstacles during the step."""
    position_error: Float[Array, "*lanes"]
    """Distance [m] of `grip` from the goal."""
    orientation_error: Float[Array, "*lanes"]
    """Angle [rad] of `grip` from the goal."""
    verdict: Verdict


class Lanes:
    """`count` episodes in one world, side by side.

    `stream` is the random stream of the worlds (see `instance_key`), another one for other problems
    than the benchmark's.
    """

    def __init__(self, world: World, count: int, seed: int, stream: int):
        self.world, self.count, self._seed, self._stream = world, count, seed, stream
        self.clock = world.episode.steps  # as after an episode: nothing to step yet
        self._state: State
        self._verdict: Verdict

    @property
    def state(self) -> State:
        """Of every lane, now; RuntimeError where no episode was begun."""
        if self.clock == 0 or hasattr(self, "_state"):
            return self._state
        raise RuntimeError("no episode to look at: reset()")

    @property
    def over(self) -> bool:
        """Whether there is no step to take: no episode was begun, or its last step was taken."""
        return self.clock >= self.world.episode.steps

    def begin(self, problems: Problem) -> Observation:
        """The first observation of new problems, one a lane."""
        self._state = _reset(self.world, self._seed, problems, self._stream)
        self.clock, self._verdict = 0, Verdict.begin((self.count,))
        return _observe(self.world, self._state)

    def errors(self) -> tuple[np.ndarray, np.ndarray]:
        """Of each lane, how far `grip` is from its goal now: [m] and [rad]."""
        position, orientation = _errors(self.world, self._state)
        return np.asarray(position), np.asarray(orientation)

    def step(self, targets: Float[np.ndarray, "lanes J"]) -> tuple[Observation, Outcome]:
        """One control step towards joint targets [rad]; RuntimeError where none is left."""
        if self.over:
            raise RuntimeError(
                "no episode to step: the last one is over, or none was begun; reset()"
            )
        self._state, self._verdict, observation, outcome = _step(
            self.world, self._state, self._verdict, targets, jnp.int32(self.clock)
        )
        self.clock += 1
        return observation, outcome


# One program a world for all lanes of a process: an environment to train in and one to look at the
# outcome share them.


@partial(jit, static_argnums=(0, 1, 3))
def _reset(world: World, seed: int, problems: Problem, stream: int) -> State:
    return jax.vmap(lambda problem: one_world.reset(world, seed, problem, stream))(problems)


@partial(jit, static_argnums=0)
def _observe(world: World, state: State) -> Observation:
    return jax.vmap(world.observe)(state)


@partial(jit, static_argnums=0)
def _errors(world: World, state: State) -> tuple[jax.Array, jax.Array]:
    def one(state: State) -> tuple[jax.Array, jax.Array]:
        position, rotation = world.robot.grip_pose(world.robot.link_poses(state.joint_position))
        wanted = quaternion_to_matrix(jnp.asarray(state.problem.goal_quaternion))
        away = position - jnp.asarray(state.problem.goal_position)
        return jnp.linalg.norm(away), rotation_angle(rotation, wanted)

    return jax.vmap(one)(state)


@partial(jit, static_argnums=0)
def _step(
    world: World,
    state: State,
    verdict: Verdict,
    targets: Float[Array, "lanes J"],
    clock: Int[Array, ""],
) -> tuple[State, Verdict, Observation, Outcome]:
    def step(state: State, verdict: Verdict, target: jax.Array) -> tuple[Any, ...]:
        state, record = one_world.apply(world, state, target, clock)
        verdict = verdict.after(record, world.task.valid(state.memory), clock)
        outcome = Outcome(
            clearance=record.clearance,
            position_error=record.position_error,
            orientation_error=record.orientation_error,
            verdict=verdict,
        )
        return state, verdict, world.observe(state), outcome

    return jax.vmap(step)(state, verdict, targets)
