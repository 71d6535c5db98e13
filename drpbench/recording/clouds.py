"""The point clouds that a policy saw, at chosen instants of an episode."""

from dataclasses import dataclass

import jax
import numpy as np

from drpbench.compile import jit
from drpbench.envs.cloud import robot_points, scene_cloud, shares
from drpbench.robot import link_poses

from .episode import Episode


@dataclass(frozen=True)
class Clouds:
    """Points [m] in the world frame at N instants. Where the mask is false there is no point."""

    scene: np.ndarray  # (N, 2048, 3): those of the static scene first, the same at every instant
    mask: np.ndarray  # (N, 2048) bool
    robot: np.ndarray  # (N, 256, 3)
    static: int
    """How many of the scene's points are on the static scene."""


def clouds(episode: Episode, instants: np.ndarray) -> Clouds:
    """The clouds at the instants (N,) given."""
    scene, mask = _scene(episode.state.cloud, episode.boxes.movers(instants))
    robot = _robot(episode.joint_position[instants])
    static, _ = shares(episode.boxes.count)
    return Clouds(np.asarray(scene), np.asarray(mask), np.asarray(robot), static)


_scene = jit(jax.vmap(scene_cloud, in_axes=(None, 0)))
_robot = jit(jax.vmap(lambda q: robot_points().world(link_poses(q))))
