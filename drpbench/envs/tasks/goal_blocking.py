"""GB, goal blocking: a box stands on the goal until shortly before the end.

Once `grip` is within 0.5 m of the goal, a box with edges of 0.2 to 0.4 m and any orientation is put
on the goal, clear of the arm by 1 cm: one draw a control step, 100 at most. It is removed 200
control steps before the end. An episode in which it was never placed is not an instance of the
task.
"""

from dataclasses import dataclass, replace

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Int, Key, PRNGKeyArray

from drpbench.contract import Episode, Movers, Problem, no_movers

from ..arm import Arm
from ..movers import clearance_of_box, random_rotation

_REMOVED = 200  # control steps at 60 Hz before the end
_NEAR = 0.5  # [m] from grip to goal
_ROOM = 0.01  # [m]
_TRIES = 100


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class _Memory:
    key: Key[Array, "*batch"]
    tries: Int[Array, "*batch"]
    placed: Bool[Array, "*batch"]


@dataclass(frozen=True)
class GoalBlocking:
    name: str = "GB"
    title: str = "goal blocking"
    movers: int = 1
    rehearsed: bool = False
    starts_at_goal: bool = False
    conditional: bool = True

    def reset(
        self, problem: Problem, arm: Arm, key: PRNGKeyArray, episode: Episode
    ) -> tuple[Movers, _Memory]:
        return no_movers(1), _Memory(key, jnp.int32(0), jnp.bool_(False))

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
        removed = episode.steps - episode.lasting(_REMOVED)
        size_key, rotation_key = jax.random.split(jax.random.fold_in(memory.key, memory.tries))
        half_size = jax.random.uniform(size_key, (3,), minval=0.1, maxval=0.2)
        rotation = random_rotation(rotation_key)
        clear = clearance_of_box(half_size, rotation, goal, arm.centers, arm.radii) > _ROOM
        near = jnp.linalg.norm(arm.grip_position - goal) < _NEAR
        due = near & ~memory.placed & (memory.tries < _TRIES) & (clock < removed)
        place = due & clear
        movers = replace(
            movers,
            half_size=jnp.where(place, half_size[None], movers.half_size),
            rotation=jnp.where(place, rotation[None], movers.rotation),
            position=jnp.where(place, goal[None], movers.position),
            active=(movers.active | place) & (clock < removed),
        )
        return movers, _Memory(memory.key, memory.tries + due, memory.placed | place)

    def valid(self, memory: _Memory) -> Bool[Array, ""]:
        return memory.placed

    def training_level(
        self, number: Int[np.ndarray, " n"], furnished: Bool[np.ndarray, " n"]
    ) -> Int[np.ndarray, " n"]:
        return np.where(furnished, 2, 1)
