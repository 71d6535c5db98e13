"""GB, goal blocking: a box stands on the goal until shortly before the end.

Once `grip` is within 0.5 m of the goal, a box with edges of 0.2 to 0.4 m and any orientation is put
on the goal, clear of the arm by 1 cm: one draw a control step, 100 at most. It is removed 200
control steps before the end. An episode in which the arm came near and no draw left it that room is
not an instance of the task. One in which the arm stayed away is: it failed.
"""

from dataclasses import dataclass, replace

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Int, Key, PRNGKeyArray

from drpbench.contract import Episode, Movers, Problem, no_movers

from ..arm import Arm
from ..movers import clearance_of_box, random_rotation
from .task import Task

_NEAR = 0.5  # [m] from grip to goal
_ROOM = 0.01  # [m]
_TRIES = 100


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class _Memory:
    key: Key[Array, "*batch"]
    tries: Int[Array, "*batch"]
    placed: Bool[Array, "*batch"]
    neared: Bool[Array, "*batch"]
    """Whether `grip` came near the goal while a box could be placed."""


@dataclass(frozen=True)
class GoalBlocking(Task):
    name: str = "GB"
    title: str = "goal blocking"
    movers: int = 1
    removal: int = 200  # control steps at 60 Hz before the end
    starts_at_goal: bool = False
    conditional: bool = True

    def reset(
        self, problem: Problem, arm: Arm, key: PRNGKeyArray, episode: Episode
    ) -> tuple[Movers, _Memory]:
        return no_movers(1), _Memory(key, jnp.int32(0), jnp.bool_(False), jnp.bool_(False))

    def advance(
        self,
        movers: Movers,
        memory: _Memory,
        problem: Problem,
        arm: Arm,
        clock: Int[Array, ""],
        episode: Episode,
    ) -> tuple[Movers, _Memory]:
        goal = jnp.asarray(problem.goal_position)
        removed = episode.steps - episode.lasting(self.removal)
        size_key, rotation_key = jax.random.split(jax.random.fold_in(memory.key, memory.tries))
        half_size = jax.random.uniform(size_key, (3,), minval=0.1, maxval=0.2)
        rotation = random_rotation(rotation_key)
        clear = clearance_of_box(half_size, rotation, goal, arm.centers, arm.radii) > _ROOM
        near = (jnp.linalg.norm(arm.grip_position - goal) < _NEAR) & (clock < removed)
        due = near & ~memory.placed & (memory.tries < _TRIES)
        place = due & clear
        movers = replace(
            movers,
            half_size=jnp.where(place, half_size[None], movers.half_size),
            rotation=jnp.where(place, rotation[None], movers.rotation),
            position=jnp.where(place, goal[None], movers.position),
            active=(movers.active | place) & (clock < removed),
        )
        return movers, _Memory(
            memory.key, memory.tries + due, memory.placed | place, memory.neared | near
        )

    def valid(self, memory: _Memory) -> Bool[Array, ""]:
        return memory.placed | ~memory.neared
