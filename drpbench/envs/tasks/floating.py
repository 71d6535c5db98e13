"""FDO, floating dynamic obstacles: three boxes drift through the workspace.

Birth: in the upper half of a shell of 0.8 to 1.0 m about (0.15, 0, 0.5), at x >= 0.1 m, clear of the
arm by 1 cm. Motion: straight, 1 to 3 mm a control step (0.06 to 0.18 m/s), headed for the shell's
centre but for a deviation of N(0, 0.2) on each axis; a box turns back 1.2 m from the centre, at
x = 0.1 m, and before the base. Removal: 300 control steps before the end.
"""

from dataclasses import dataclass, replace

import jax
import jax.numpy as jnp
import numpy as np

from drpbench.contract import CONTROL_STEPS

from ..movers import base_column_radius, drift, drifting_box, in_upper_shell

_CENTER = np.array([0.15, 0.0, 0.5], np.float32)  # [m]
_REMOVED = CONTROL_STEPS - 300


def _excess(position, column):
    """How far [m] a box's centre is outside the region it may drift in."""
    from_center = jnp.linalg.norm(position - _CENTER, axis=-1) - 1.2
    from_base = column - jnp.linalg.norm(position[..., :2], axis=-1)
    return jnp.maximum(jnp.maximum(from_center, from_base), 0.1 - position[..., 0])


@dataclass(frozen=True)
class Floating:
    name: str = "FDO"
    title: str = "floating dynamic obstacles"
    movers: int = 3
    rehearsed: bool = False
    stays: bool = False
    conditional: bool = False
    training_levels: tuple[tuple[int, ...], tuple[int, ...]] = ((1,), (2,))

    def reset(self, problem, arm, key):
        # Edges of 0.1 to 0.2 m on level 1 (the bare table), up to 0.3 m on level 2.
        longest = jnp.where(problem.level == 1, 0.2, 0.3)

        def place(key):
            position = in_upper_shell(key, jnp.asarray(_CENTER), 0.8, 1.0)
            return position.at[0].set(jnp.where(position[0] < 0.1, 0.5, position[0]))

        def born(key):
            center = jnp.asarray(_CENTER)
            return drifting_box(key, longest, place, _excess, center, 0.2, arm.centers, arm.radii)

        return jax.vmap(born)(jax.random.split(key, self.movers)), ()

    def advance(self, movers, memory, problem, arm, clock):
        column = base_column_radius(movers.half_size)
        movers = drift(movers, lambda position: _excess(position, column))
        return replace(movers, active=movers.active & (clock < _REMOVED)), memory

    def valid(self, memory):
        return jnp.bool_(True)
