"""Episodes that a caller steps: one compiled program for all lanes, which share one clock.

An event at a fixed time then costs nothing in other steps (see `drpbench.envs.Task`), and every lane's
episode begins and ends with the others'.
"""

from dataclasses import dataclass, replace
from functools import cache

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from drpbench.compile import jit
from drpbench.contract import CONTROL_STEPS, REACH_ORIENTATION, REACH_POSITION, Observation, Problem
from drpbench.envs import State, Task, World
from drpbench.rollout.batch import instance_key, record


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Verdict:
    """How each lane's episode stands after a control step; after the last one, that is its outcome."""

    clearance: Float[Array, "*lanes"]
    """Smallest signed distance [m] between arm and obstacles during the step."""
    position_error: Float[Array, "*lanes"]
    """Distance [m] of `grip` from the goal."""
    orientation_error: Float[Array, "*lanes"]
    """Angle [rad] of `grip` from the goal."""
    reached: Bool[Array, "*lanes"]
    """Within 1 cm and 15 degrees now."""
    collided: Bool[Array, "*lanes"]
    """Touched an obstacle in this step or an earlier one."""
    finite: Bool[Array, "*lanes"]
    """Every target and every state so far was made of numbers; an episode that was not has failed."""
    valid: Bool[Array, "*lanes"]
    """Whether the episode is an instance of its task so far (GB: whether the goal was blocked)."""

    @property
    def success(self) -> Bool[Array, "*lanes"]:
        """Reached, and never collided: the benchmark's, if this is the last step."""
        return self.reached & ~self.collided


class Lanes:
    """`count` episodes of one task, side by side.

    `stream` is the random stream of the worlds (see `instance_key`), another one for other problems than
    the benchmark's.
    """

    def __init__(self, task: Task, count: int, seed: int, stream: int):
        self.task, self.count = task, count
        self.clock = CONTROL_STEPS  # as after an episode: nothing to step yet
        self.rehearsal = False
        self._programs = _programs(task, seed, stream)
        self._path: list[jax.Array] = []

    @property
    def over(self) -> bool:
        """Whether there is no step to take: no episode was begun, or its last step was taken."""
        return self.clock >= CONTROL_STEPS

    @property
    def rehearsed(self) -> bool:
        """Whether the episode that ended was a rehearsal, so that `second_pass` comes next."""
        return self.rehearsal and self.over

    def begin(self, problems: Problem) -> Observation:
        """The first observation of new problems, one a lane. Of SAO, a rehearsal begins."""
        self._first = self._programs.reset(problems)
        return self._start(rehearsal=self.task.rehearsed)

    def second_pass(self) -> Observation:
        """The same problems again, now with a box on the path that the rehearsal took."""
        path = jnp.stack(self._path, axis=1)
        memory = jax.vmap(self.task.second_pass)(self._first.memory, path)
        self._first = replace(self._first, memory=memory)
        return self._start(rehearsal=False)

    def step(self, targets: Float[np.ndarray, "lanes 7"]) -> tuple[Observation, Verdict]:
        """One control step, 1/60 s, towards joint targets [rad]; RuntimeError where none is left."""
        if self.over:
            raise RuntimeError(
                "no episode to step: the last one is over, or none was begun; reset()"
            )
        self._state, self._tally, grip, observation, verdict = self._programs.step(
            self._state, self._tally, targets, jnp.int32(self.clock)
        )
        if self.rehearsal:
            self._path.append(grip)
        self.clock += 1
        return observation, verdict

    def _start(self, rehearsal: bool) -> Observation:
        self.clock, self.rehearsal, self._path = 0, rehearsal, []
        self._state = self._first
        self._tally = _Tally(jnp.zeros(self.count, bool), jnp.ones(self.count, bool))
        return self._programs.observe(self._first)


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class _Tally:
    """What a verdict remembers of earlier steps."""

    collided: Bool[Array, "*lanes"]
    finite: Bool[Array, "*lanes"]


class _Programs:
    """The compiled functions of one task's lanes, whatever their number."""

    def __init__(self, task: Task, seed: int, stream: int):
        self.world = World(task)

        def reset(problem: Problem) -> State:
            return self.world.reset(problem, instance_key(seed, task.name, problem.id, stream))

        self.reset = jit(jax.vmap(reset))
        self.observe = jit(jax.vmap(self.world.observe))
        self.step = jit(jax.vmap(self._step, in_axes=(0, 0, 0, None)))

    def _step(
        self, state: State, tally: _Tally, target: Float[Array, "7"], clock: Int[Array, ""]
    ) -> tuple[State, _Tally, Float[Array, "3"], Observation, Verdict]:
        state, events = self.world.step(state, target, clock)
        seen = record(state, events)
        position_error, orientation_error = seen["position_error"], seen["orientation_error"]
        at_goal = (position_error < REACH_POSITION) & (orientation_error < REACH_ORIENTATION)
        tally = _Tally(tally.collided | (events.clearance < 0.0), tally.finite & events.finite)
        verdict = Verdict(
            clearance=events.clearance,
            position_error=position_error,
            orientation_error=orientation_error,
            reached=at_goal & tally.finite,
            collided=tally.collided,
            finite=tally.finite,
            valid=self.world.task.valid(state.memory),
        )
        return state, tally, events.grip_position, self.world.observe(state), verdict


@cache
def _programs(task: Task, seed: int, stream: int) -> _Programs:
    """Compiled once a process: an environment to train in and one to look at the outcome share them."""
    return _Programs(task, seed, stream)
