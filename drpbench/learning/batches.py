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
"""

from __future__ import annotations

from dataclasses import dataclass

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, PRNGKeyArray

from drpbench.contract import EPISODE, ROBOT_POINTS
from drpbench.geometry import Primitives, sample_surface
from drpbench.policies.networks.chunks import CHUNK, RAMP, SPEED, encode
from drpbench.robot import PANDA, Robot

from .demonstrations import Demonstrations

BESIDE = 0.03  # [rad] standard deviation of the largest offsets from the path
AT_REST = 0.08  # share of samples at the end of a path
DENSITY_SPREAD = 0.8  # of the logarithm of how densely each obstacle is seen


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
    which_key, sample_key = jax.random.split(key)
    which = jax.random.randint(which_key, (count,), 0, demonstrations.count)
    chosen = jax.tree.map(lambda leaf: leaf[which], demonstrations)
    keys = jax.random.split(sample_key, count)
    return jax.vmap(
        lambda one, obstacles, key: _sample_one(one, obstacles, key, scene_points, robot)
    )(chosen, chosen.obstacles.primitives(), keys)


def _sample_one(
    one: Demonstrations, obstacles: Primitives, key: PRNGKeyArray, scene_points: int, robot: Robot
) -> Batch:
    """One sample of one demonstration (leaves without their batch axis)."""
    place_key, rest_key, size_key, offset_key, cloud_key = jax.random.split(key, 5)
    path, length, goal = map(jnp.asarray, (one.path, one.length, one.goal))
    share = jax.random.uniform(place_key)
    share = jnp.where(jax.random.uniform(rest_key) < AT_REST, 1.0, share)
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
    )


def cloud(
    key: PRNGKeyArray, obstacles: Primitives, count: int
) -> tuple[Float[Array, "count 3"], Bool[Array, " count"]]:
    """Points on the obstacles at z >= 0, as in the world, and which of them there are.

    In half of the clouds each obstacle is seen more or less densely, by a random factor: in the
    world the points of moving boxes are denser than those of furniture.
    """
    points_key, spread_key, half_key = jax.random.split(key, 3)
    spread = DENSITY_SPREAD * (jax.random.uniform(half_key) < 0.5)
    density = jnp.exp(spread * jax.random.normal(spread_key, (obstacles.count,)))
    points, _ = sample_surface(points_key, obstacles, 2 * count, density)
    # The first `count` points above the table's surface, by their running number.
    number = jnp.cumsum(points[:, 2] >= -1e-6)
    first = jnp.searchsorted(number, jnp.arange(1, count + 1))
    there = (jnp.arange(1, count + 1) <= number[-1]) & obstacles.mask.any()
    return jnp.where(there[:, None], points[jnp.minimum(first, 2 * count - 1)], 0.0), there
