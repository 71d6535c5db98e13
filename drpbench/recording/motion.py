"""Where the arm was at each instant of an episode, how near to the obstacles, and what it
touched."""

from dataclasses import dataclass
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np

from drpbench.compile import jit
from drpbench.contract import Movers, Problem, reached
from drpbench.envs import World
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
from drpbench.robot import LinkPoses, Robot

from .episode import Recording


@dataclass(frozen=True)
class Motion:
    """What follows from the recorded joints, N instants. World frame, quaternions wxyz."""

    robot: Robot
    link_position: np.ndarray  # (N, F, 3) [m] of the arm's frames, the base first and the hand last
    link_quaternion: np.ndarray  # (N, F, 4)
    grip_position: np.ndarray  # (N, 3) [m]
    position_error: np.ndarray  # (N,) [m], grip to goal
    orientation_error: np.ndarray  # (N,) [rad]
    clearance: np.ndarray  # (N,) [m], smaller of the two substeps that lead to the instant
    link: np.ndarray  # (N,) index into `link_names` of the link nearest to an obstacle
    contact_point: np.ndarray  # (N, 3) [m], the obstacle's surface point nearest to that link
    mover_quaternion: np.ndarray  # (N, M, 4)

    @property
    def touching(self) -> np.ndarray:
        """(N,) bool: whether the verdict calls the control step before the instant a collision."""
        return self.clearance < 0.0

    def touched(self, instant: int) -> str | None:
        """The link in contact, or None."""
        return self.robot.link_names[self.link[instant]] if self.touching[instant] else None

    @property
    def at_goal(self) -> np.ndarray:
        """(N,) bool: whether `grip` is at its goal."""
        return np.asarray(reached(self.position_error, self.orientation_error))


def motion(episode: Recording) -> Motion:
    """Kinematics, distances and contacts of every instant.

    The world makes two substeps a control step, and MuJoCo's integrators add the new velocity: the
    middle is q_end - qd_end * period / 2. Obstacles move at the start of a control step.
    """
    world, problem = episode.world, episode.problem
    q, qd = episode.joint_position, episode.joint_velocity
    movers = episode.boxes.movers(slice(None))
    searched = slice(None) if episode.sphere is None else slice(1)
    some = episode.boxes.movers(searched)
    sphere = np.asarray(_nearest_sphere(world, problem, q[searched], qd[searched], some))
    if episode.sphere is not None:
        sphere = np.concatenate([sphere, episode.sphere])
    found = _follow(world, problem, q, qd, movers, sphere)
    return Motion(world.robot, **jax.tree.map(np.asarray, found))


def _middle(world: World, q: jax.Array, qd: jax.Array) -> jax.Array:
    return q - qd * (world.episode.period / 2)


def _obstacles(problem: Problem, movers: Movers) -> Primitives:
    return concatenate(jax.tree.map(jnp.asarray, problem.obstacles), movers.primitives())


def _search(
    world: World, problem: Problem, q: jax.Array, qd: jax.Array, movers: Movers
) -> jax.Array:
    """Index of the sphere that comes nearest to an obstacle in either substep."""
    robot, obstacles = world.robot, _obstacles(problem, movers)
    model = robot.moving_spheres

    def gaps(joints: jax.Array) -> jax.Array:
        return signed_distance(model.world(robot.link_poses(joints)), obstacles) - model.radius

    return jnp.argmin(jnp.minimum(gaps(_middle(world, q, qd)), gaps(q)))


def _whole(
    world: World, problem: Problem, q: jax.Array, qd: jax.Array, movers: Movers, sphere: jax.Array
) -> dict[str, jax.Array]:
    robot, obstacles = world.robot, _obstacles(problem, movers)
    model, poses = robot.moving_spheres, robot.link_poses(q)
    local, frame, radius, link = (
        jnp.asarray(part)[sphere] for part in (model.local, model.frame, model.radius, model.link)
    )

    def nearest_to(poses: LinkPoses) -> tuple[jax.Array, ...]:
        center = poses.position[frame] + jnp.sum(poses.rotation[frame] * local, axis=-1)
        return center, *nearest(center, obstacles)

    middle, end = nearest_to(robot.link_poses(_middle(world, q, qd))), nearest_to(poses)
    center, away, which = jax.tree.map(
        lambda a, b: jnp.where(middle[1] < end[1], a, b), middle, end
    )
    position, rotation = robot.grip_pose(poses)
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


@partial(jit, static_argnums=0)
def _nearest_sphere(
    world: World, problem: Problem, q: jax.Array, qd: jax.Array, movers: Movers
) -> jax.Array:
    search = partial(_search, world, problem)
    return jax.vmap(search)(q, qd, movers)


@partial(jit, static_argnums=0)
def _follow(
    world: World,
    problem: Problem,
    q: jax.Array,
    qd: jax.Array,
    movers: Movers,
    sphere: jax.Array,
) -> dict[str, jax.Array]:
    return jax.vmap(partial(_whole, world, problem))(q, qd, movers, sphere)


@partial(jit, static_argnums=0)
def _arm_at(robot: Robot, joints: jax.Array) -> tuple[jax.Array, jax.Array]:
    poses = jax.vmap(robot.link_poses)(joints)
    return poses.position, matrix_to_quaternion(poses.rotation)


def arm_at(robot: Robot, joints: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Positions (N, F, 3) [m] and quaternions (N, F, 4) wxyz of the arm's frames at joints (N, J)
    [rad]."""
    position, quaternion = _arm_at(robot, jnp.asarray(joints, jnp.float32))
    return np.asarray(position), np.asarray(quaternion)
