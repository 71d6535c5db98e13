"""The point clouds that a policy saw, at chosen instants of an episode."""

from dataclasses import dataclass, replace
from functools import partial

import jax
import numpy as np

from drpbench.compile import jit
from drpbench.contract import Movers
from drpbench.envs import State, World

from .episode import Recording


@dataclass(frozen=True)
class Clouds:
    """Points [m] in the world frame at N instants. Where a mask is false there is no point."""

    static: np.ndarray  # (S, 3) those of the static scene, the same at every instant
    static_mask: np.ndarray  # (S,) bool
    boxes: np.ndarray  # (N, B, 3)
    boxes_mask: np.ndarray  # (N, B) bool
    robot: np.ndarray  # (N, P, 3)


def clouds(episode: Recording, instants: np.ndarray) -> Clouds:
    """The clouds at the instants (N,) given."""
    cloud, movers = episode.state.cloud, episode.boxes.movers(instants)
    seen = _seen(episode.world, episode.state, episode.joint_position[instants], movers)
    return Clouds(*map(np.asarray, (cloud.static_points, cloud.static_mask, *seen)))


@partial(jit, static_argnums=0)
def _seen(
    world: World, state: State, joints: jax.Array, movers: Movers
) -> tuple[jax.Array, jax.Array, jax.Array]:
    """The points on the boxes, which of them there are, and the arm's."""
    static = len(state.cloud.static_mask)

    def once(q: jax.Array, movers: Movers) -> tuple[jax.Array, jax.Array, jax.Array]:
        seen = world.observe(replace(state, joint_position=q, movers=movers))
        return seen.scene_points[static:], seen.scene_mask[static:], seen.robot_points

    return jax.vmap(once)(joints, movers)
