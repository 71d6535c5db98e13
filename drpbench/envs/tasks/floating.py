"""FDO, floating dynamic obstacles: three boxes drift through the workspace.

Birth: in the upper half of a shell of 0.8 to 1.0 m about (0.15, 0, 0.5), at x >= 0.1 m, clear of
the arm by 1 cm. Motion: straight, 1 to 3 mm a control step (0.06 to 0.18 m/s), headed for the
shell's centre but for a deviation of N(0, 0.2) on each axis; a box turns back 1.2 m from the
centre, at x = 0.1 m, 0.25 m from the base's axis, and before the core of the first link, which no
policy can move aside. Removal: 300 control steps before the end.
"""

from dataclasses import dataclass, replace

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, PRNGKeyArray

from drpbench.contract import Episode, Movers, Problem

from ..arm import Arm
from ..movers import drift, drifting_box, in_upper_shell
from .task import Task

_CENTER = np.array([0.15, 0.0, 0.5], np.float32)  # [m]
_COLUMN = 0.25  # [m] about the base's axis


def _excess(position: Float[Array, "*boxes 3"]) -> Float[Array, "*boxes"]:
    """How far [m] a box's centre is outside the region it may drift in."""
    from_center = jnp.linalg.norm(position - _CENTER, axis=-1) - 1.2
    from_base = _COLUMN - jnp.linalg.norm(position[..., :2], axis=-1)
    return jnp.maximum(jnp.maximum(from_center, from_base), 0.1 - position[..., 0])


@dataclass(frozen=True)
class Floating(Task):
    name: str = "FDO"
    title: str = "floating dynamic obstacles"
    movers: int = 3
    removal: int = 300  # control steps at 60 Hz before the end
    starts_at_goal: bool = False
    conditional: bool = False

    def reset(
        self, problem: Problem, arm: Arm, key: PRNGKeyArray, episode: Episode
    ) -> tuple[Movers, tuple[()]]:
        # Edges of 0.1 to 0.2 m on level 1 (the bare table), up to 0.3 m on level 2.
        longest = jnp.where(problem.level == 1, 0.2, 0.3)

        def place(key: PRNGKeyArray) -> Float[Array, "3"]:
            position = in_upper_shell(key, jnp.asarray(_CENTER), 0.8, 1.0)
            return position.at[0].set(jnp.where(position[0] < 0.1, 0.5, position[0]))

        def born(key: PRNGKeyArray) -> Movers:
            center = jnp.asarray(_CENTER)
            return drifting_box(key, longest, place, _excess, center, 0.2, arm, episode.pace)

        return jax.vmap(born)(jax.random.split(key, self.movers)), ()

    def advance(
        self,
        movers: Movers,
        memory: tuple[()],
        problem: Problem,
        arm: Arm,
        clock: Int[Array, ""],
        episode: Episode,
    ) -> tuple[Movers, tuple[()]]:
        movers = drift(movers, _excess, arm.robot)
        removed = episode.steps - episode.lasting(self.removal)
        return replace(movers, active=movers.active & (clock < removed)), memory
