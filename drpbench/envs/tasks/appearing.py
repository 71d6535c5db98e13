"""SAO, suddenly appearing obstacle: a box appears on the policy's own path.

Two passes. The first, without an obstacle, records where the policy takes `grip`. In the second, at
control step 30 and every 200 steps from there, a box is put on the first later pose of that path
(looked at every 5 steps) that leaves room to the arm as it stands then; where no pose does, the box
stays as it was. It is removed 100 control steps before the end.
"""

from dataclasses import dataclass, field, replace

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, Key, PRNGKeyArray

from drpbench.contract import Episode, Movers, Problem, no_movers

from ..arm import Arm
from ..movers import clearance_of_box, random_rotation

_FIRST, _EVERY, _STRIDE, _REMOVED = 30, 200, 5, 100  # control steps at 60 Hz


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class _Memory:
    key: Key[Array, "*batch"]
    path: Float[Array, "*batch poses 3"]
    """Positions of grip [m] after every `stride`th control step of the first pass, the first one's
    first."""
    known: Bool[Array, "*batch"]
    """Whether the first pass has been; without a path nothing appears."""
    stride: int = field(metadata={"static": True})
    """Control steps between two poses of the path: 5 at 60 Hz."""


@dataclass(frozen=True)
class Appearing:
    name: str = "SAO"
    title: str = "suddenly appearing obstacle"
    movers: int = 1
    rehearsed: bool = True
    starts_at_goal: bool = False
    conditional: bool = False

    def reset(
        self, problem: Problem, arm: Arm, key: PRNGKeyArray, episode: Episode
    ) -> tuple[Movers, _Memory]:
        stride = episode.lasting(_STRIDE)
        path = jnp.zeros((-(-episode.steps // stride), 3))
        return no_movers(1), _Memory(key, path, jnp.bool_(False), stride)

    def second_pass(self, memory: _Memory, path: Float[Array, "steps 3"]) -> _Memory:
        """The memory to start the second pass with: `path` is grip's [m] after each step of the
        first."""
        return replace(memory, path=path[:: memory.stride], known=jnp.bool_(True))

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
        removed = episode.steps - episode.lasting(_REMOVED)

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
            later = jnp.arange(len(memory.path)) * memory.stride > clock
            fits = memory.known & later & (room > jnp.where(wide, 0.2, 0.1))
            found = fits.any()
            return replace(
                movers,
                half_size=jnp.where(found, half_size[None], movers.half_size),
                rotation=jnp.where(found, rotation[None], movers.rotation),
                position=jnp.where(found, memory.path[jnp.argmax(fits)][None], movers.position),
                active=movers.active | found,
            )

        due = (clock >= first) & ((clock - first) % every == 0) & (clock < removed)
        movers = jax.lax.cond(due, place, lambda movers: movers, movers)
        return replace(movers, active=movers.active & (clock < removed)), memory

    def valid(self, memory: _Memory) -> Bool[Array, ""]:
        return jnp.bool_(True)

    def training_level(
        self, number: Int[np.ndarray, " n"], furnished: Bool[np.ndarray, " n"]
    ) -> Int[np.ndarray, " n"]:
        return np.where(furnished, 2, 1)
