"""SAO, suddenly appearing obstacle: a box appears on the policy's own path.

Two passes. The first, without an obstacle, records where the policy takes `grip`. In the second, at
control step 30 and every 200 steps from there, a box is put on the first later pose of that path
(looked at every 5 steps) that leaves room to the arm as it stands then; where no pose does, the box
stays as it was. It is removed 100 control steps before the end.
"""

from dataclasses import dataclass, replace

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Key

from drpbench.contract import CONTROL_STEPS, no_movers

from ..movers import clearance_of_box, random_rotation

_FIRST, _EVERY, _STRIDE = 30, 200, 5
_REMOVED = CONTROL_STEPS - 100


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class _Memory:
    key: Key[Array, "*batch"]
    path: Float[Array, "*batch poses 3"]
    """Positions of grip [m] after control steps 0, 5, 10, ... of the first pass."""
    known: Bool[Array, "*batch"]
    """Whether the first pass has been; without a path nothing appears."""


@dataclass(frozen=True)
class Appearing:
    name: str = "SAO"
    title: str = "suddenly appearing obstacle"
    movers: int = 1
    rehearsed: bool = True
    stays: bool = False
    conditional: bool = False
    training_levels: tuple[tuple[int, ...], tuple[int, ...]] = ((1,), (2,))

    def reset(self, problem, arm, key):
        path = jnp.zeros((CONTROL_STEPS // _STRIDE, 3))
        return no_movers(1), _Memory(key, path, jnp.bool_(False))

    def second_pass(self, memory: _Memory, path: Float[Array, "steps 3"]) -> _Memory:
        """The memory to start the second pass with: `path` is grip's [m] after each step of the first."""
        return replace(memory, path=path[::_STRIDE], known=jnp.bool_(True))

    def advance(self, movers, memory, problem, arm, clock):
        def place(movers):
            # Level 1 (bare table): edges 0.05 to 0.3 m, 0.2 m of room; levels 2, 3: 0.1 to 0.2 m, 0.1 m.
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
            later = jnp.arange(len(memory.path)) * _STRIDE > clock
            fits = memory.known & later & (room > jnp.where(wide, 0.2, 0.1))
            found = fits.any()
            return replace(
                movers,
                half_size=jnp.where(found, half_size[None], movers.half_size),
                rotation=jnp.where(found, rotation[None], movers.rotation),
                position=jnp.where(found, memory.path[jnp.argmax(fits)][None], movers.position),
                active=movers.active | found,
            )

        due = (clock >= _FIRST) & ((clock - _FIRST) % _EVERY == 0) & (clock < _REMOVED)
        movers = jax.lax.cond(due, place, lambda movers: movers, movers)
        return replace(movers, active=movers.active & (clock < _REMOVED)), memory

    def valid(self, memory):
        return jnp.bool_(True)
