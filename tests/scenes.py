"""Small problems built by hand, for the tests."""

from functools import cache

import jax
import jax.numpy as jnp
import numpy as np

from drpbench.compile import jit
from drpbench.contract import ROBOT_POINTS, SCENE_POINTS, Observation, Problem
from drpbench.geometry import BOX, Primitives, matrix_to_quaternion
from drpbench.robot import PANDA


def boxes(*placed, width=2):
    """Boxes from (centre, half extents) or (centre, half extents, rotation), padded with masked
    ones."""
    width = max(width, len(placed))
    half_size = np.full((width, 3), 0.01, np.float32)
    position = np.zeros((width, 3), np.float32)
    rotation = np.tile(np.eye(3, dtype=np.float32), (width, 1, 1))
    for i, (center, half, *turn) in enumerate(placed):
        position[i], half_size[i] = center, half
        if turn:
            rotation[i] = turn[0]
    return Primitives(
        kind=np.full(width, BOX, np.int32),
        half_size=half_size,
        position=position,
        rotation=rotation,
        mask=np.arange(width) < len(placed),
    )


@cache
def _bodies():
    def bodies(q):
        poses = PANDA.link_poses(q)
        position, rotation = PANDA.grip_pose(poses)
        centers = PANDA.moving_spheres.world(poses)
        return centers, position, matrix_to_quaternion(rotation), PANDA.self_clearance(poses)

    return jit(jax.vmap(bodies))


def bodies(q):
    """Of configurations (B, 7): sphere centres (B, S, 3), grip's positions (B, 3) and quaternions
    (B, 4), self-clearance (B,). Computed 64 at a time, so that it is compiled once."""
    q = np.atleast_2d(np.asarray(q, np.float32))
    parts = []
    for first in range(0, len(q), 64):
        part = q[first : first + 64]
        padded = np.resize(part, (64, 7))
        parts.append([np.asarray(values)[: len(part)] for values in _bodies()(padded)])
    return tuple(np.concatenate(values) for values in zip(*parts, strict=True))


def problem(start=PANDA.home, goal=None, obstacles=None, level=1, id=0):
    """A problem; by default from home to home, without obstacles."""
    start = np.asarray(start, np.float32)
    goal = start if goal is None else np.asarray(goal, np.float32)
    _, position, quaternion, _ = bodies(goal)
    return Problem(
        id=np.asarray(id, np.int32),
        level=np.asarray(level, np.int32),
        start=start,
        goal=goal,
        goal_position=position[0],
        goal_quaternion=quaternion[0],
        obstacles=boxes() if obstacles is None else obstacles,
    )


def batch(problems):
    """Problems of one shape as one batch."""
    return jax.tree.map(lambda *leaves: np.stack(leaves), *problems)


def postures(count, seed=0):
    """Random configurations (count, 7): hands and elbows above the table, no link in another."""
    rng = np.random.default_rng(seed)
    q = rng.uniform(PANDA.joint_lower + 0.1, PANDA.joint_upper - 0.1, (8 * count, 7))
    centers, _, _, apart = bodies(q)
    above = (centers[..., 2] - PANDA.moving_spheres.radius).min(axis=1) > 0.01
    q = q[above & (apart > 0.0)]
    assert len(q) >= count
    return q[:count].astype(np.float32)


def observation(q, goal=None, velocity=None, points=()):
    """What a policy sees of an arm among scene points (n, 3); the rest of the cloud is masked."""
    q = np.asarray(q, np.float32)
    goal = q if goal is None else np.asarray(goal, np.float32)
    _, position, quaternion, _ = bodies(goal)
    scene = np.zeros((SCENE_POINTS, 3), np.float32)
    scene[: len(points)] = np.reshape(points, (-1, 3))
    return Observation(
        joint_position=jnp.asarray(q),
        joint_velocity=jnp.zeros(7) if velocity is None else jnp.asarray(velocity, jnp.float32),
        goal_joints=jnp.asarray(goal),
        goal_position=jnp.asarray(position[0]),
        goal_quaternion=jnp.asarray(quaternion[0]),
        scene_points=jnp.asarray(scene),
        scene_mask=jnp.arange(SCENE_POINTS) < len(points),
        robot_points=jnp.zeros((ROBOT_POINTS, 3)),
    )
