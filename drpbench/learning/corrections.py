"""Corrections: the expert shows the way on from where a policy drifts away (DAgger; Ross, Gordon
and Bagnell, 2011).

The policy leads the arm through demonstrated scenes, without dynamics: the arm is at each target
when the next one is asked for. Of each episode one configuration is kept, mostly the last ones
before the arm touches something, and from there the expert plans to the same goal. What a policy
has learned from its own mistakes no offset beside a demonstrated path can teach it.

Each episode is then interrupted at a random time and goes on in the same scene with one box more,
that stands on the policy's own way or on its goal; of that one too a configuration is kept.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import cache, partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray

from drpbench.compile import jit
from drpbench.contract import ROBOT_POINTS, SCENE_POINTS, Observation, Policy
from drpbench.envs.movers import clearance_of_box
from drpbench.geometry import BOX, Obstacles, Primitives, matrix_to_quaternion, quaternion_to_matrix
from drpbench.planning.clearance_cost import gaps
from drpbench.planning.expert import CHEAP, planner
from drpbench.robot import PANDA, Robot

from .batches import cloud
from .demonstrations import Demonstrations, Shards, join
from .production import SHARD, batch_size

STEPS = 100  # targets of an episode: five seconds, if the arm is three control steps behind
_TOUCH = 0.004  # [m] of room at which an episode is over
_ARRIVED = 0.05  # [rad]
_JUST_BEFORE = 6  # of the last targets before a touch, one is kept ...
_SHARE_BEFORE = 0.7  # ... in so many of the episodes that touch; else any of the way
_SKIPPED = 3  # waypoints of the old path, from the nearest, that the hint leaves out
_SMALL, _LARGE = (0.025, 0.12), (0.1, 0.2)  # [m] half sizes of a box on the way, on the goal
_ROOM = (0.02, 0.12)  # [m] that it leaves to the arm as it stands then, at least
_TRIES = 64  # boxes drawn
_ON_GOAL = 0.3  # share of the boxes that appear on the goal, not on the way


def _walk(
    policy: Policy,
    start: Float[Array, " J"],
    goal: Float[Array, " J"],
    obstacles: Primitives,
    key: PRNGKeyArray,
    robot: Robot,
) -> tuple[Float[Array, "T J"], Float[Array, " T"]]:
    """Where the policy leads the arm [rad], and its room there [m]."""
    points, mask = cloud(key, obstacles, SCENE_POINTS)
    position, rotation = robot.grip_pose(robot.link_poses(goal))

    def observe(q):
        return Observation(
            joint_position=q,
            joint_velocity=jnp.zeros_like(q),
            goal_joints=goal,
            goal_position=position,
            goal_quaternion=matrix_to_quaternion(rotation),
            scene_points=points,
            scene_mask=mask,
            robot_points=robot.surface_points(ROBOT_POINTS).world(robot.link_poses(q)),
        )

    def step(state, key):
        q, carry = state
        target, carry = policy.act(observe(q), carry, key)
        q = jnp.clip(target, robot.joint_lower, robot.joint_upper)
        return (q, carry), (q, jnp.min(gaps(q, obstacles, robot).obstacle))

    begun = (start, policy.init(observe(start)))
    _, walked = jax.lax.scan(step, begun, jax.random.split(key, STEPS))
    return walked


def _last(
    walked: Float[Array, "T J"], room: Float[Array, " T"], goal: Float[Array, " J"]
) -> tuple[Int[Array, ""], Bool[Array, ""]]:
    """The last target before the arm touches something or is at its goal, and whether it touches;
    -1: none."""
    number = jnp.arange(STEPS)
    touch = jnp.min(jnp.where(room < _TOUCH, number, STEPS))
    arrived = jnp.max(jnp.abs(walked - goal), axis=-1) < _ARRIVED
    last = jnp.minimum(touch, jnp.min(jnp.where(arrived, number, STEPS))) - 1
    return last, (touch < STEPS) & (touch == last + 1)


def _stray(
    walked: Float[Array, "T J"],
    room: Float[Array, " T"],
    goal: Float[Array, " J"],
    key: PRNGKeyArray,
) -> tuple[Float[Array, " J"], Bool[Array, ""]]:
    """A configuration to go on from, and whether there is one: free, and not yet at the goal."""
    last, touches = _last(walked, room, goal)
    which, before, anywhere = jax.random.split(key, 3)
    just_before = (jax.random.uniform(which) < _SHARE_BEFORE) & touches
    chosen = jnp.where(
        just_before,
        last - jax.random.randint(before, (), 0, _JUST_BEFORE),
        jnp.floor(jax.random.uniform(anywhere) * (last + 1)).astype(jnp.int32),
    )
    return walked[jnp.maximum(chosen, 0)], last >= 0


def _interrupted(
    demonstration: Demonstrations,
    walked: Float[Array, "T J"],
    room: Float[Array, " T"],
    key: PRNGKeyArray,
    robot: Robot = PANDA,
) -> tuple[Demonstrations, Float[Array, " J"], Bool[Array, ""]]:
    """The scene with one box more, that appears while the arm is under way; where the arm is then;
    and whether one was found that leaves it room, and is on the goal or leaves room to the arm
    there too."""
    goal = jnp.asarray(demonstration.goal)
    last = _last(walked, room, goal)[0]
    way = jnp.concatenate([walked, goal[None]])
    poses = jax.vmap(robot.link_poses)(way)
    place, _ = jax.vmap(robot.grip_pose)(poses)
    model = robot.moving_spheres
    centers, radii = jax.vmap(model.world)(poses), jnp.asarray(model.radius)
    blocks_key, key = jax.random.split(key)
    blocks = jax.random.uniform(blocks_key) < _ON_GOAL

    def attempt(key):
        time_key, place_key, size_key, room_key, turn_key = jax.random.split(key, 5)
        time = jnp.floor(jax.random.uniform(time_key) * (last + 1)).astype(jnp.int32)
        later = jax.random.randint(place_key, (), time + 1, last + 2)
        least, most = jnp.where(blocks, jnp.array(_LARGE), jnp.array(_SMALL))
        half_size = jax.random.uniform(size_key, (3,), minval=least, maxval=most)
        quaternion = jax.random.normal(turn_key, (4,))
        quaternion = quaternion / jnp.linalg.norm(quaternion)
        position = place[jnp.where(blocks, STEPS, later)]
        rotation = quaternion_to_matrix(quaternion)
        now, then = (
            clearance_of_box(half_size, rotation, position, centers[at], radii)
            for at in (time, STEPS)
        )
        wanted = jax.random.uniform(room_key, minval=_ROOM[0], maxval=_ROOM[1])
        fits = (now > wanted) & (blocks | (then > _ROOM[0]))
        return time, half_size, position, quaternion, fits

    found = jax.vmap(attempt)(jax.random.split(key, _TRIES))
    first = jnp.argmax(found[-1])
    time, half_size, position, quaternion, fits = jax.tree.map(lambda leaf: leaf[first], found)
    there = jax.tree.map(jnp.asarray, demonstration.obstacles)
    slot = jnp.argmin(there.mask)
    more = Obstacles(
        kind=there.kind.at[slot].set(BOX),
        half_size=there.half_size.at[slot].set(half_size),
        position=there.position.at[slot].set(position),
        quaternion=there.quaternion.at[slot].set(quaternion),
        mask=there.mask.at[slot].set(True),
    )
    scene = replace(demonstration, obstacles=more)
    return scene, walked[time], (last >= 0) & fits & ~there.mask[slot]


def _hint(path: Float[Array, "m J"], q: Float[Array, " J"]) -> Float[Array, "m J"]:
    """From `q` to a waypoint a little beyond the nearest of the old path, and along it."""
    nearest = jnp.argmin(jnp.max(jnp.abs(path - q), axis=-1))
    return (
        path[jnp.minimum(nearest + _SKIPPED + jnp.arange(len(path)) - 1, len(path) - 1)]
        .at[0]
        .set(q)
    )


@cache
def _strays(robot: Robot) -> Callable[..., Any]:
    @partial(jax.vmap, in_axes=(None, 0, 0))
    def both(policy, demonstration, key):
        """Scene, where the arm has strayed to, whether it has, and a hint: without and with a box
        more."""
        goal, path = demonstration.goal, demonstration.path
        walk_key, stray_key, box_key, again_key, last_key = jax.random.split(key, 5)
        way = _walk(policy, path[0], goal, demonstration.obstacles.primitives(), walk_key, robot)
        q, usable = _stray(*way, goal, stray_key)
        scene, start, placed = _interrupted(demonstration, *way, box_key, robot)
        way = _walk(policy, start, goal, scene.obstacles.primitives(), again_key, robot)
        boxed, strayed = _stray(*way, goal, last_key)
        return (
            (demonstration, q, usable, _hint(path, q)),
            (scene, boxed, strayed & placed, _hint(path, boxed)),
        )

    return jit(both)


def correct(
    policy: Policy, demonstrations: Demonstrations, seed: int, robot: Robot = PANDA
) -> Demonstrations:
    """The expert's paths from where `policy` drifts away in each of up to `batch_size()`
    demonstrations, and again with one box more; those that it solves."""
    count = demonstrations.count
    filled = jax.tree.map(
        lambda leaf: np.resize(leaf, (batch_size(), *leaf.shape[1:])), demonstrations
    )
    keys = jax.vmap(lambda index: jax.random.fold_in(jax.random.key(seed), index))(filled.index)
    parts = []
    for scenes, starts, usable, hints in _strays(robot)(policy, filled, keys):
        plans = planner(CHEAP, robot)(
            scenes.obstacles.primitives(), starts, scenes.goal, keys, hints[:, None]
        )
        good = np.flatnonzero(np.asarray(plans.success & usable)[:count])
        found = replace(scenes, path=plans.path, length=plans.length, reached=plans.reached)
        parts.append(jax.tree.map(lambda leaf, good=good: np.asarray(leaf)[good], found))
    return join(parts)


def fill_corrections(
    shards: Shards,
    policy: Policy,
    demonstrations: Demonstrations,
    count: int,
    seed: int,
    progress: Callable[[int, int], None],
    robot: Robot = PANDA,
) -> None:
    """Makes the shards that are not there yet, from the first `count` demonstrations.

    `progress(demonstrations, corrections)` is called after every batch.
    """
    missing = shards.missing(range(count), SHARD)
    progress(count - sum(map(len, missing)), shards.solved(range(count)))
    for numbers in missing:
        parts = []
        for first in numbers[:: batch_size()]:
            upto = min(first + batch_size(), numbers.stop)
            some = jax.tree.map(lambda leaf, a=first, b=upto: leaf[a:b], demonstrations)
            parts.append(correct(policy, some, seed, robot))
            progress(some.count, parts[-1].count)
        shards.add(numbers, join(parts))
