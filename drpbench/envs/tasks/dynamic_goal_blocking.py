"""DGB, dynamic goal blocking: the arm is at its goal, and boxes come for it.

The start is the goal configuration: the arm has to give way and come back. Birth: in the upper half of
a shell of 0.5 to 0.6 m about the goal, at x >= 0.15 m, clear of the arm by 1 cm; one box, three on
level 2. Motion: as in FDO, headed for the goal but for N(0, 0.01); a box turns back 1.0 m from the
goal, at x = 0.15 m, and before the base up to 0.6 m of height. Removal: 300 steps before the end.
"""

from dataclasses import dataclass, replace

import jax
import jax.numpy as jnp

from drpbench.contract import CONTROL_STEPS

from ..movers import base_column_radius, drift, drifting_box, in_upper_shell

_REMOVED = CONTROL_STEPS - 300


def _excess(position, goal, column):
    """How far [m] a box's centre is outside the region it may drift in."""
    from_goal = jnp.linalg.norm(position - goal, axis=-1) - 1.0
    into_column = column - jnp.linalg.norm(position[..., :2], axis=-1)
    into_column = jnp.minimum(into_column, 0.6 - position[..., 2])
    return jnp.maximum(jnp.maximum(from_goal, into_column), 0.15 - position[..., 0])


@dataclass(frozen=True)
class DynamicGoalBlocking:
    name: str = "DGB"
    title: str = "dynamic goal blocking"
    movers: int = 3
    rehearsed: bool = False
    stays: bool = True
    conditional: bool = False
    training_levels: tuple[tuple[int, ...], tuple[int, ...]] = ((1, 1, 1, 2), (1, 1, 1, 2))

    def reset(self, problem, arm, key):
        goal = problem.goal_position

        def place(key):
            return in_upper_shell(key, goal, 0.5, 0.6)

        def excess(position, column):
            return _excess(position, goal, column)

        def born(key):
            return drifting_box(key, 0.3, place, excess, goal, 0.01, arm.centers, arm.radii)

        movers = jax.vmap(born)(jax.random.split(key, self.movers))
        boxes = jnp.where(problem.level == 2, 3, 1)
        return replace(movers, active=jnp.arange(self.movers) < boxes), ()

    def advance(self, movers, memory, problem, arm, clock):
        column = base_column_radius(movers.half_size)
        movers = drift(movers, lambda p: _excess(p, problem.goal_position, column))
        return replace(movers, active=movers.active & (clock < _REMOVED)), memory

    def valid(self, memory):
        return jnp.bool_(True)
