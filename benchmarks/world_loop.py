"""Many worlds driven for some control steps, as one compiled program: what the timings are made
of."""

import time

import jax
import jax.numpy as jnp
import numpy as np

from drpbench.compile import jit
from drpbench.contract import Observation, Problem
from drpbench.envs import TASKS, State, World
from drpbench.problems import TaskProblems
from drpbench.rollout import instance_key


def most_obstacles(problems: TaskProblems, scenes: int) -> list[int]:
    """The ids of the problems with the most obstacles, two of each family at most."""
    chosen: list[int] = []
    families = np.array(problems.family)
    for index in np.argsort(-problems.obstacles.mask.sum(axis=1), kind="stable"):
        if (families[chosen] == families[index]).sum() < 2:
            chosen.append(int(index))
    return chosen[:scenes]


class WorldLoop:
    """A batch of worlds of one task whose arms head for the goal at the joints' velocity limits.

    Each control step is the whole of it: the task's obstacles, two substeps of dynamics with
    contact and verdict, and the observation with its point clouds, which is written out at every
    step.
    """

    def __init__(self, task: str, problems: Problem, steps: int):
        self.steps, self.batch = steps, len(problems.id)
        world = World(TASKS[task])

        def reset(problem: Problem) -> State:
            return world.reset(problem, instance_key(0, task, problem.id, 0))

        def step(carry: tuple[State, Observation], clock: jax.Array):
            state, seen = carry
            state, events = jax.vmap(world.step, in_axes=(0, 0, None))(
                state, seen.goal_joints, clock
            )
            return (state, jax.vmap(world.observe)(state)), events

        def advance(state: State):
            first = jax.vmap(world.observe)(state)
            clocks = jnp.arange(steps, dtype=jnp.int32)
            return jax.lax.scan(step, (state, first), clocks)

        self._start = jit(jax.vmap(reset))(jax.tree.map(jnp.asarray, problems))
        self._advance = jit(advance)
        self.seconds()  # compiles

    def seconds(self) -> float:
        """Time [s] of `steps` control steps of all worlds, from the start."""
        began = time.perf_counter()
        jax.block_until_ready(self._advance(self._start))
        return time.perf_counter() - began

    def rate(self) -> float:
        """Control steps per second, over all worlds."""
        return self.batch * self.steps / self.seconds()


def batch_of(problems: TaskProblems, ids: list[int], batch: int) -> Problem:
    """The problems `ids` in turn, `batch` in all."""
    return problems.take([ids[i % len(ids)] for i in range(batch)])
