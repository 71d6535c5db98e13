"""All that can be seen of one world at one instant."""

from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from drpbench.contract import Policy, reached
from drpbench.envs import State, World
from drpbench.geometry import (
    matrix_to_quaternion,
    nearest,
    normal,
    quaternion_to_matrix,
    rotation_angle,
    signed_distance,
)
from drpbench.perception.surface_cloud import shares
from drpbench.policies import DcpRmp, Reaction
from drpbench.robot import Robot

Frames = tuple[np.ndarray, np.ndarray]
"""Positions (F, 3) [m] and quaternions (F, 4) wxyz of the arm's frames, the base first and the hand
last."""


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Moment:
    """World frame, [m], [rad], quaternions wxyz; a NumPy array or number each."""

    arm: Frames
    goal: Frames
    goal_position: np.ndarray  # (3,) of grip
    goal_quaternion: np.ndarray  # (4,)
    position_error: np.ndarray  # () of grip to the goal
    orientation_error: np.ndarray  # ()
    clearance: np.ndarray  # () smallest distance of arm and obstacles now
    link: np.ndarray  # () index into the arm's `link_names` of the link it belongs to
    contact_point: np.ndarray  # (3,) the obstacle's surface point nearest to that link
    box_half_size: np.ndarray  # (M, 3) of the task's boxes
    box_position: np.ndarray  # (M, 3)
    box_rotation: np.ndarray  # (M, 3, 3)
    box_quaternion: np.ndarray  # (M, 4) the same
    box_active: np.ndarray  # (M,) bool: whether it is there
    points: np.ndarray  # (2048, 3) as the policy sees them, those of the static scene first
    seen: np.ndarray  # (2048,) bool, false where there is no point
    reaction: Reaction | None
    """What DCP-RMP makes of it; None where it is not the policy's outermost part."""
    modified: Frames | None
    """The arm at DCP-RMP's modified goal."""

    @property
    def reached(self) -> bool:
        """Whether the arm is at its goal now."""
        return bool(reached(self.position_error, self.orientation_error))

    def points_of(self, box: int | None) -> tuple[np.ndarray, np.ndarray]:
        """The points (P, 3) on one of the task's boxes, or on the static scene, and which are seen
        (P,)."""
        static, each = shares(len(self.box_active))
        part = (
            slice(static) if box is None else slice(static + box * each, static + (box + 1) * each)
        )
        return self.points[part], self.seen[part]


def moment(world: World, policy: Policy, state: State, carry: Any) -> Moment:
    """What there is to see of a world, for `jit`; `carry` is what the policy would be given
    next."""
    observation = world.observe(state)
    robot, obstacles, problem = world.robot, world.obstacles(state), state.problem
    model, poses = robot.moving_spheres, robot.link_poses(state.joint_position)
    centers = model.world(poses)
    gaps = signed_distance(centers, obstacles) - model.radius
    sphere = jnp.argmin(gaps)
    away, which = nearest(centers[sphere], obstacles)
    position, rotation = robot.grip_pose(poses)
    goal = jnp.asarray(problem.goal)
    goal_rotation = quaternion_to_matrix(jnp.asarray(problem.goal_quaternion))
    reaction = policy.reaction(observation, carry) if isinstance(policy, DcpRmp) else None
    seen: dict[str, Any] = dict(  # on the device; what `jit` returns is fetched as NumPy's
        arm=_frames(robot, state.joint_position),
        goal=_frames(robot, goal),
        goal_position=problem.goal_position,
        goal_quaternion=problem.goal_quaternion,
        position_error=jnp.linalg.norm(position - problem.goal_position),
        orientation_error=rotation_angle(rotation, goal_rotation),
        clearance=gaps[sphere],
        link=jnp.asarray(model.link)[sphere],
        contact_point=centers[sphere] - away * normal(centers[sphere], obstacles, which),
        box_half_size=state.movers.half_size,
        box_position=state.movers.position,
        box_rotation=state.movers.rotation,
        box_quaternion=matrix_to_quaternion(state.movers.rotation),
        box_active=state.movers.active,
        points=observation.scene_points,
        seen=observation.scene_mask,
        reaction=reaction,
        modified=None if reaction is None else _frames(robot, jnp.asarray(reaction.goal_joints)),
    )
    return Moment(**seen)


def _frames(robot: Robot, joints: jax.Array) -> tuple[jax.Array, jax.Array]:
    poses = robot.link_poses(joints)
    return poses.position, matrix_to_quaternion(poses.rotation)
