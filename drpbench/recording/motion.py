"""Where the arm was at each instant of an episode, how near to the obstacles, and what it touched."""

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np

from drpbench.compile import jit
from drpbench.envs import CONTROL_PERIOD, Movers, Problem
from drpbench.geometry import (
    concatenate,
    matrix_to_quaternion,
    nearest,
    normal,
    quaternion_to_matrix,
    signed_distance,
)
from drpbench.robot import LINKS, grip_pose, link_poses, moving_spheres

from .episode import Episode


@dataclass(frozen=True)
class Motion:
    """What follows from the recorded joints, N instants. World frame, quaternions wxyz."""

    link_position: np.ndarray  # (N, 9, 3) [m] link0 to link7 and the hand
    link_quaternion: np.ndarray  # (N, 9, 4)
    grip_position: np.ndarray  # (N, 3) [m]
    position_error: np.ndarray  # (N,) [m], grip to goal
    orientation_error: np.ndarray  # (N,) [rad]
    clearance: np.ndarray  # (N,) [m], smaller of the two substeps that lead to the instant
    link: np.ndarray  # (N,) index into LINKS of the link nearest to an obstacle
    contact_point: np.ndarray  # (N, 3) [m], the obstacle's surface point nearest to that link
    mover_quaternion: np.ndarray  # (N, M, 4)

    @property
    def touching(self) -> np.ndarray:
        """(N,) bool: whether the verdict calls the control step before the instant a collision."""
        return self.clearance < 0.0

    def touched(self, instant: int) -> str | None:
        """The link in contact, or None."""
        return LINKS[self.link[instant]] if self.touching[instant] else None


def motion(episode: Episode) -> Motion:
    """Kinematics, distances and contacts of every instant.

    The world makes two substeps a control step, and MuJoCo's integrators add the new velocity: the
    middle is q_end - qd_end / 120. Obstacles move at the start of a control step.
    """
    found = _follow(
        episode.problem,
        episode.joint_position,
        episode.joint_velocity,
        episode.boxes.movers(slice(None)),
    )
    return Motion(**jax.tree.map(np.asarray, found))


def _whole(problem: Problem, q: jax.Array, qd: jax.Array, movers: Movers) -> dict[str, jax.Array]:
    model = moving_spheres()
    obstacles = concatenate(jax.tree.map(jnp.asarray, problem.obstacles), movers.primitives())

    def gaps(joints):
        centers = model.world(link_poses(joints))
        return centers, signed_distance(centers, obstacles) - model.radius

    middle, end = gaps(q - qd * (CONTROL_PERIOD / 2)), gaps(q)
    centers, distance = jax.tree.map(
        lambda a, b: jnp.where(middle[1].min() < end[1].min(), a, b), middle, end
    )
    sphere = jnp.argmin(distance)
    center = centers[sphere]
    away, which = nearest(center, obstacles)
    poses = link_poses(q)
    position, rotation = grip_pose(poses)
    turn = rotation - quaternion_to_matrix(jnp.asarray(problem.goal_quaternion))
    # |R - R_goal|_F = 2 sqrt(2) sin(angle / 2)
    sine = jnp.sqrt(jnp.sum(turn * turn)) / (2.0 * jnp.sqrt(2.0))
    return {
        "link_position": poses.position,
        "link_quaternion": matrix_to_quaternion(poses.rotation),
        "grip_position": position,
        "position_error": jnp.linalg.norm(position - problem.goal_position),
        "orientation_error": 2.0 * jnp.arcsin(jnp.minimum(sine, 1.0)),
        "clearance": distance[sphere],
        "link": jnp.asarray(model.link)[sphere],
        "contact_point": center - away * normal(center, obstacles, which),
        "mover_quaternion": matrix_to_quaternion(movers.rotation),
    }


_follow = jit(jax.vmap(_whole, in_axes=(None, 0, 0, 0)))
_arm_at = jit(lambda q: (lambda p: (p.position, matrix_to_quaternion(p.rotation)))(link_poses(q)))


def arm_at(joints: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Positions (9, 3) [m] and quaternions (9, 4) wxyz of link0 to link7 and the hand."""
    position, quaternion = _arm_at(jnp.asarray(joints, jnp.float32))
    return np.asarray(position), np.asarray(quaternion)
