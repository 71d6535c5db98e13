"""Training samples, made on the accelerator: a place on a demonstrated path, what would be seen
there, and where the arm should be in the next control steps.

The policy sees positions and no velocities, so what it learns is a field: at this configuration, in
this scene, move so. From paths that start from rest it would learn to stay at rest. Therefore paths
are walked at a speed that depends on the place alone: constant, and falling in proportion to the
way that is left at the end,

    dr/dt = -SPEED min(1, r / NEAR),    r: way left [s at the velocity limits]

so that the arm converges to the goal, or to where it has to stop. The arm is put beside the path by
a random offset, from which it is led back within the same time constant, NEAR / SPEED: without
that, a policy that strays has never seen the way back.

A demonstration is worth more than itself. A path that reaches its goal is walked back as often. The
whole is turned about the base by any angle that joint 1 allows, if that joint's axis is vertical
and goes through the base. And in half of the samples the place is one with little room, if there is
one among a few that are drawn: most of a path is in the open, and contacts are not.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, PRNGKeyArray

from drpbench.contract import EPISODE, ROBOT_POINTS
from drpbench.geometry import Primitives, sample_surface
from drpbench.planning.clearance_cost import gaps
from drpbench.planning.joint_limits import LIMIT_MARGIN
from drpbench.policies.networks.chunks import CHUNK, RAMP, SPEED, encode
from drpbench.robot import PANDA, Robot

from .demonstrations import Demonstrations

BESIDE = 0.03  # [rad] standard deviation of the largest offsets from the path
AT_REST = 0.08  # share of samples at the end of a path
DENSITY_SPREAD = 0.8  # of the logarithm of how densely each obstacle is seen
TIGHT = 0.04  # [m] of room: less is little
TIGHT_SHARE = 0.5  # of samples that look for such a place
_CANDIDATES = 4  # places that they look at
TURNED_SHARE = 0.7  # of samples that are turned about the base


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Batch:
    """Samples: what the network sees, and the chunk it should answer."""

    scene_points: Float[Array, "*batch N 3"]
    scene_mask: Bool[Array, "*batch N"]
    robot_points: Float[Array, "*batch 256 3"]
    joints: Float[Array, "*batch J"]
    goal: Float[Array, "*batch J"]
    chunk: Float[Array, "*batch C J"]
    obstacles: Primitives
    """What the scene's points are of: for a loss, not for a network."""


def near(robot: Robot = PANDA) -> float:
    """NEAR [s at the velocity limits]: what the slowest joint needs for the ramp of a chunk's
    units."""
    return RAMP / float(robot.velocity_limit.min())


def way_left(
    left: Float[Array, "*batch"], time: Float[Array, "*batch"], robot: Robot = PANDA
) -> Float[Array, "*batch"]:
    """The way left r [s at the velocity limits] after `time` [s]: the solution of dr/dt above."""
    until_near = jnp.maximum(left - near(robot), 0.0) / SPEED
    tau = near(robot) / SPEED  # [s]
    falling = jnp.minimum(left, near(robot)) * jnp.exp(-jnp.maximum(time - until_near, 0.0) / tau)
    return jnp.where(time < until_near, left - SPEED * time, falling)


def along(path: Float[Array, "T J"], share: Float[Array, "*n"]) -> Float[Array, "*n J"]:
    """Configurations at shares (0 to 1) of a path."""
    place = jnp.clip(share, 0.0, 1.0) * (path.shape[0] - 1)
    before = jnp.minimum(place.astype(jnp.int32), path.shape[0] - 2)
    weight = (place - before)[..., None]
    return path[before] * (1.0 - weight) + path[before + 1] * weight


def sample(
    key: PRNGKeyArray,
    demonstrations: Demonstrations,
    count: int,
    scene_points: int,
    robot: Robot = PANDA,
) -> Batch:
    """`count` independent samples, with clouds of `scene_points` points."""
    keys = jax.random.split(key, count)
    return jax.vmap(lambda key: _sample_one(demonstrations, key, scene_points, robot))(keys)


def _sample_one(
    demonstrations: Demonstrations, key: PRNGKeyArray, scene_points: int, robot: Robot
) -> Batch:
    place_key, back_key, turn_key, size_key, offset_key, cloud_key = jax.random.split(key, 6)
    one, share = _place(demonstrations, place_key, robot)
    obstacles = one.obstacles.primitives()
    path, length, goal = map(jnp.asarray, (one.path, one.length, one.goal))
    back = one.reached & (jax.random.uniform(back_key) < 0.5)
    path, goal = jnp.where(back, path[::-1], path), jnp.where(back, path[0], goal)
    share = jnp.where(back & (share < 1.0), 1.0 - share, share)  # at rest it stays at the end
    if _turns(robot):
        angle = _angle(path, goal, turn_key, robot)
        path, goal, obstacles = (
            path.at[:, 0].add(angle),
            goal.at[0].add(angle),
            turned(obstacles, angle),
        )
    on_path = along(path, share)
    offset = BESIDE * jax.random.uniform(size_key) * jax.random.normal(offset_key, (robot.joints,))
    q = jnp.clip(on_path + offset, robot.joint_lower, robot.joint_upper)

    time = EPISODE.period * jnp.arange(1, CHUNK + 1)
    left = way_left(length * (1.0 - share) * jnp.ones(CHUNK), time, robot)
    ahead = along(path, 1.0 - left / jnp.maximum(length, 1e-6))
    waypoints = ahead + (q - on_path) * jnp.exp(-time / (near(robot) / SPEED))[:, None]

    points, mask = cloud(cloud_key, obstacles, scene_points)
    return Batch(
        scene_points=points,
        scene_mask=mask,
        robot_points=robot.surface_points(ROBOT_POINTS).world(robot.link_poses(q)),
        joints=q,
        goal=goal,
        chunk=encode(waypoints, q, goal),
        obstacles=obstacles,
    )


def _place(
    demonstrations: Demonstrations, key: PRNGKeyArray, robot: Robot
) -> tuple[Demonstrations, Float[Array, ""]]:
    """A demonstration and how far along its path; often one with little room there."""
    which_key, share_key, rest_key, tight_key = jax.random.split(key, 4)
    which = jax.random.randint(which_key, (_CANDIDATES,), 0, demonstrations.count)
    share = jax.random.uniform(share_key, (_CANDIDATES,))
    rests = jax.random.uniform(rest_key, (_CANDIDATES,)) < AT_REST
    share = jnp.where(rests, 1.0, share)

    def room(which: Array, share: Array) -> Array:
        one = jax.tree.map(lambda leaf: jnp.asarray(leaf)[which], demonstrations)
        q = along(one.path, share)
        return jnp.min(gaps(q, one.obstacles.primitives(), robot).obstacle)

    tight = jax.vmap(room)(which, share) < TIGHT
    looks = jax.random.uniform(tight_key) < TIGHT_SHARE
    chosen = jnp.where(looks, jnp.argmax(tight), 0)
    one = jax.tree.map(lambda leaf: jnp.asarray(leaf)[which[chosen]], demonstrations)
    return one, share[chosen]


def _turns(robot: Robot) -> bool:
    """Whether the world turned about z is the same world for the arm, its first joint moved."""
    return bool(robot.joint_twist[0] == 0.0 and not robot.joint_offset[0][:2].any())


def _angle(
    path: Float[Array, "T J"], goal: Float[Array, " J"], key: PRNGKeyArray, robot: Robot
) -> Float[Array, ""]:
    """[rad] about the base, within what joint 1 can follow."""
    turn_key, angle_key = jax.random.split(key)
    first = jnp.append(path[:, 0], goal[0])
    least = jnp.minimum(robot.joint_lower[0] + LIMIT_MARGIN - jnp.min(first), 0.0)
    most = jnp.maximum(robot.joint_upper[0] - LIMIT_MARGIN - jnp.max(first), 0.0)
    angle = jax.random.uniform(angle_key, minval=least, maxval=most)
    return jnp.where(jax.random.uniform(turn_key) < TURNED_SHARE, angle, 0.0)


def turned(obstacles: Primitives, angle: Float[Array, ""]) -> Primitives:
    """Those of one scene, turned by `angle` [rad] about the world's z axis."""
    c, s = jnp.cos(angle), jnp.sin(angle)
    x, y, z = (obstacles.position[..., i] for i in range(3))
    rows = (obstacles.rotation[..., i, :] for i in range(3))
    first, second, third = rows
    return replace(
        obstacles,
        position=jnp.stack([c * x - s * y, s * x + c * y, z], axis=-1),
        rotation=jnp.stack([c * first - s * second, s * first + c * second, third], axis=-2),
    )


def cloud(
    key: PRNGKeyArray, obstacles: Primitives, count: int
) -> tuple[Float[Array, "count 3"], Bool[Array, " count"]]:
    """Points on the obstacles, as in the world, and which of them there are.

    Where what bears the arm, the first obstacle, has its top at z = 0, it is the ground: no point
    below it is seen. In half of the clouds each obstacle is seen more or less densely, by a random
    factor: in the world the points of moving boxes are denser than those of furniture.
    """
    points_key, spread_key, half_key = jax.random.split(key, 3)
    spread = DENSITY_SPREAD * (jax.random.uniform(half_key) < 0.5)
    density = jnp.exp(spread * jax.random.normal(spread_key, (obstacles.count,)))
    points, _ = sample_surface(points_key, obstacles, 2 * count, density)
    # The first `count` points that are seen, by their running number.
    ground = obstacles.position[0, 2] + obstacles.half_size[0, 2] > -1e-4
    number = jnp.cumsum((points[:, 2] >= -1e-6) | ~ground)
    first = jnp.searchsorted(number, jnp.arange(1, count + 1))
    there = (jnp.arange(1, count + 1) <= number[-1]) & obstacles.mask.any()
    return jnp.where(there[:, None], points[jnp.minimum(first, 2 * count - 1)], 0.0), there
