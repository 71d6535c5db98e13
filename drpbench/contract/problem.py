"""What an episode starts from."""

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from drpbench.geometry import Primitives

WAY_POINTS = 128


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Problem:
    """One numbered planning problem, batched over any leading axes.

    The static scene is `obstacles`; J joints. `goal` is one configuration that reaches the goal
    pose of the frame `grip` (`goal_position` [m], `goal_quaternion` wxyz). `level` is the task's
    own: sizes and counts of moving obstacles depend on it. `witness` are W configurations [rad]
    along a path from start to goal that is free of collision in the static scene.
    """

    id: Int[Array, "*batch"] | Int[np.ndarray, "*batch"]
    level: Int[Array, "*batch"] | Int[np.ndarray, "*batch"]
    start: Float[Array, "*batch J"] | Float[np.ndarray, "*batch J"]
    goal: Float[Array, "*batch J"] | Float[np.ndarray, "*batch J"]
    goal_position: Float[Array, "*batch 3"] | Float[np.ndarray, "*batch 3"]
    goal_quaternion: Float[Array, "*batch 4"] | Float[np.ndarray, "*batch 4"]
    obstacles: Primitives
    witness: Float[Array, "*batch W J"] | Float[np.ndarray, "*batch W J"] | None = None

    def way(self) -> Float[Array, "*batch W J"]:
        """The witness, or the straight line from start to goal where none is known."""
        if self.witness is not None:
            return jnp.asarray(self.witness)
        share = jnp.linspace(0.0, 1.0, WAY_POINTS)[:, None]
        start, goal = (jnp.asarray(q)[..., None, :] for q in (self.start, self.goal))
        return start + share * (goal - start)
