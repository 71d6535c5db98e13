"""The point clouds that a policy saw, at chosen instants of an episode."""

from dataclasses import dataclass

import jax
import numpy as np

from drpbench.compile import jit
from drpbench.contract import ROBOT_POINTS, Movers
from drpbench.perception.surface_cloud import Cloud, scene_cloud
from drpbench.robot import PANDA

from .episode import Episode


@dataclass(frozen=True)
class Clouds:
    """Points [m] in the world frame at N instants. Where a mask is false there is no point."""

    static: np.ndarray  # (S, 3) those of the static scene, the same at every instant
    static_mask: np.ndarray  # (S,) bool
    boxes: np.ndarray  # (N, B, 3)
    boxes_mask: np.ndarray  # (N, B) bool
    robot: np.ndarray  # (N, 256, 3)


def clouds(episode: Episode, instants: np.ndarray) -> Clouds:
    """The clouds at the instants (N,) given."""
    cloud = episode.state.cloud
    boxes, mask = _boxes(cloud, episode.boxes.movers(instants))
    robot = _robot(episode.joint_position[instants])
    return Clouds(
        *map(np.asarray, (cloud.static_points, cloud.static_mask, boxes, mask, robot)),
    )


def _on_boxes(cloud: Cloud, movers: Movers) -> tuple[jax.Array, jax.Array]:
    points, mask = scene_cloud(cloud, movers)
    static = len(cloud.static_mask)
    return points[static:], mask[static:]


_boxes = jit(jax.vmap(_on_boxes, in_axes=(None, 0)))
_robot = jit(jax.vmap(lambda q: PANDA.surface_points(ROBOT_POINTS).world(PANDA.link_poses(q))))
