"""Where the arm was at each instant of an episode, how near to the obstacles, and what it touched."""

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np

from drpbench.compile import jit
from drpbench.contract import CONTROL_PERIOD, Movers, Problem
from drpbench.geometry import (
    Primitives,
    concatenate,
    matrix_to_quaternion,
    nearest,
    normal,
    quaternion_to_matrix,
    rotation_angle,
    signed_distance,
)
from drpbench.robot import PANDA, LinkPoses

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
        return PANDA.link_names[self.link[instant]] if self.touching[instant] else None


def motion(episode: Episode) -> Motion:
    """Kinematics, distances and contacts of every instant.

    The world makes two substeps a control step, and MuJoCo's integrators add the new velocity: the
    middle is q_end - qd_end / 120. Obstacles move at the start of a control step.
    """
    problem, q, qd = episode.problem, episode.joint_position, episode.joint_velocity
    movers = episode.boxes.movers(slice(None))
    searched = slice(None) if episode.sphere is None else slice(1)
    some = episode.boxes.movers(searched)
    sphere = np.asarray(_nearest_sphere(problem, q[searched], qd[searched], some))
    if episode.sphere is not None:
        sphere = np.concatenate([sphere, episode.sphere])
    found = _follow(problem, q, qd, movers, sphere)
    return Motion(**jax.tree.map(np.asarray, found))


def _middle(q: jax.Array, qd: jax.Array) -> jax.Array:
    return q - qd * (CONTROL_PERIOD / 2)


def _obstacles(problem: Problem, movers: Movers) -> Primitives:
    return concatenate(jax.tree.map(jnp.asarray, problem.obstacles), movers.primitives())


def _search(problem: Problem, q: jax.Array, qd: jax.Array, movers: Movers) -> jax.Array:
    """Index of the sphere that comes nearest to an obstacle in either substep."""
    model, obstacles = PANDA.moving_spheres, _obstacles(problem, movers)

    def gaps(joints: jax.Array) -> jax.Array:
        return signed_distance(model.world(PANDA.link_poses(joints)), obstacles) - model.radius

    return jnp.argmin(jnp.minimum(gaps(_middle(q, qd)), gaps(q)))


def _whole(
    problem: Problem, q: jax.Array, qd: jax.Array, movers: Movers, sphere: jax.Array
) -> dict[str, jax.Array]:
    model, obstacles = PANDA.moving_spheres, _obstacles(problem, movers)
    poses = PANDA.link_poses(q)
    local, frame, radius, link = (
        jnp.asarray(part)[sphere] for part in (model.local, model.frame, model.radius, model.link)
    )

    def nearest_to(poses: LinkPoses) -> tuple[jax.Array, ...]:
        center = poses.position[frame] + jnp.sum(poses.rotation[frame] * local, axis=-1)
        return center, *nearest(center, obstacles)

    middle, end = nearest_to(PANDA.link_poses(_middle(q, qd))), nearest_to(poses)
    center, away, which = jax.tree.map(
        lambda a, b: jnp.where(middle[1] < end[1], a, b), middle, end
    )
    position, rotation = PANDA.grip_pose(poses)
    goal_rotation = quaternion_to_matrix(jnp.asarray(problem.goal_quaternion))
    return {
        "link_position": poses.position,
        "link_quaternion": matrix_to_quaternion(poses.rotation),
        "grip_position": position,
        "position_error": jnp.linalg.norm(position - problem.goal_position),
        "orientation_error": rotation_angle(rotation, goal_rotation),
        "clearance": away - radius,
        "link": link,
        "contact_point": center - away * normal(center, obstacles, which),
        "mover_quaternion": matrix_to_quaternion(movers.rotation),
    }


_nearest_sphere = jit(jax.vmap(_search, in_axes=(None, 0, 0, 0)))
_follow = jit(jax.vmap(_whole, in_axes=(None, 0, 0, 0, 0)))


@jit
@jax.vmap
def _arm_at(q: jax.Array) -> tuple[jax.Array, jax.Array]:
    poses = PANDA.link_poses(q)
    return poses.position, matrix_to_quaternion(poses.rotation)


def arm_at(joints: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Positions (N, 9, 3) [m] and quaternions (N, 9, 4) wxyz of link0 to link7 and the hand, for (N, 7)."""
    position, quaternion = _arm_at(jnp.asarray(joints, jnp.float32))
    return np.asarray(position), np.asarray(quaternion)
