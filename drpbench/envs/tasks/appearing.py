"""SAO, suddenly appearing obstacle: a box appears on the way to the goal, ahead of the arm.

The way is the problem's witness: the certified path from start to goal, the same for every policy.
At control step 30 and every 200 steps from there, a box is put on the first point of it that is
ahead of the arm (beyond the point nearest to `grip`) and leaves room to the arm as it stands then.
Where no point does, a box that is there stays as it was; without one, it is put on the point ahead
that leaves most room, if that is a centimetre. It is removed 100 control steps before the end. An
episode in which no box appeared is not an instance of the task.
"""

from dataclasses import dataclass, replace

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, Key, PRNGKeyArray

from drpbench.contract import Episode, Movers, Problem, no_movers

from ..arm import Arm
from ..movers import clearance_of_box, random_rotation
from .task import Task

_FIRST, _EVERY = 30, 200  # control steps at 60 Hz
_LEAST_ROOM = 0.01  # [m]


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class _Memory:
    key: Key[Array, "*batch"]
    path: Float[Array, "*batch W 3"]
    """Positions of grip [m] along the witness."""
    appeared: Bool[Array, "*batch"]


@dataclass(frozen=True)
class Appearing(Task):
    name: str = "SAO"
    title: str = "suddenly appearing obstacle"
    movers: int = 1
    removal: int = 100  # control steps at 60 Hz before the end
    starts_at_goal: bool = False
    conditional: bool = True

    def reset(
        self, problem: Problem, arm: Arm, key: PRNGKeyArray, episode: Episode
    ) -> tuple[Movers, _Memory]:
        robot = arm.robot
        path = jax.vmap(lambda q: robot.grip_pose(robot.link_poses(q))[0])(problem.way())
        return no_movers(1), _Memory(key, path, jnp.bool_(False))

    def advance(
        self,
        movers: Movers,
        memory: _Memory,
        problem: Problem,
        arm: Arm,
        clock: Int[Array, ""],
        episode: Episode,
    ) -> tuple[Movers, _Memory]:
        first, every = episode.lasting(_FIRST), episode.lasting(_EVERY)
        removed = episode.steps - episode.lasting(self.removal)

        def place(movers: Movers) -> Movers:
            # Level 1 (bare table): edges 0.05 to 0.3 m, 0.2 m of room; levels 2, 3: 0.1 to 0.2 m,
            # 0.1 m.
            wide = problem.level == 1
            size_key, rotation_key = jax.random.split(jax.random.fold_in(memory.key, clock))
            half_size = jax.random.uniform(size_key, (3,))
            half_size = jnp.where(wide, 0.025 + 0.125 * half_size, 0.05 + 0.05 * half_size)
            rotation = random_rotation(rotation_key)
            room = jax.vmap(
                lambda position: clearance_of_box(
                    half_size, rotation, position, arm.centers, arm.radii
                )
            )(memory.path)
            reached = jnp.argmin(jnp.linalg.norm(memory.path - arm.grip_position, axis=-1))
            room = jnp.where(jnp.arange(len(memory.path)) > reached, room, -jnp.inf)
            fits = room > jnp.where(wide, 0.2, 0.1)
            roomiest = jnp.argmax(room)
            instead = ~movers.active.any() & (room[roomiest] > _LEAST_ROOM)
            found = fits.any() | instead
            where = jnp.where(fits.any(), jnp.argmax(fits), roomiest)
            return replace(
                movers,
                half_size=jnp.where(found, half_size[None], movers.half_size),
                rotation=jnp.where(found, rotation[None], movers.rotation),
                position=jnp.where(found, memory.path[where][None], movers.position),
                active=movers.active | found,
            )

        due = (clock >= first) & ((clock - first) % every == 0) & (clock < removed)
        movers = jax.lax.cond(due, place, lambda movers: movers, movers)
        movers = replace(movers, active=movers.active & (clock < removed))
        return movers, replace(memory, appeared=memory.appeared | movers.active.any())

    def valid(self, memory: _Memory) -> Bool[Array, ""]:
        return memory.appeared
