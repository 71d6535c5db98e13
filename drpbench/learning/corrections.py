"""Corrections: the expert shows the way on from where a policy went astray (DAgger; Ross, Gordon and
Bagnell, 2011).

The policy leads the arm through demonstrated scenes, without dynamics: the arm is at each target when the
next one is asked for. Of each episode one configuration is kept, mostly the last ones before the arm
touches something, and from there the expert plans to the same goal. What a policy has learned from its own
mistakes no offset beside a demonstrated path can teach it.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import cache, partial

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, PRNGKeyArray

from drpbench.compile import jit
from drpbench.envs import Observation
from drpbench.envs.cloud import robot_points
from drpbench.geometry import matrix_to_quaternion
from drpbench.policies import Policy
from drpbench.policies.impact import SCENE_POINTS
from drpbench.robot import JOINT_LOWER, JOINT_UPPER, grip_pose, link_poses

from .batches import cloud
from .clearance_cost import gaps
from .demonstrations import Demonstrations, Shards, join
from .expert import CHEAP, planner
from .production import SHARD, batch_size

STEPS = 100  # targets of an episode: five seconds, if the arm is three control steps behind
_TOUCH = 0.004  # [m] of room at which an episode is over
_ARRIVED = 0.05  # [rad]
_JUST_BEFORE = 6  # of the last targets before a touch, one is kept ...
_SHARE_BEFORE = 0.7  # ... in so many of the episodes that touch; else any of the way
_SKIPPED = 3  # waypoints of the old path, from the nearest, that the hint leaves out


def _walk(
    policy: Policy, demonstration: Demonstrations, key: PRNGKeyArray
) -> tuple[Float[Array, "T 7"], Float[Array, " T"]]:
    """Where the policy leads the arm from a demonstration's start [rad], and its room there [m]."""
    obstacles, goal = demonstration.obstacles(), demonstration.goal
    points, mask = cloud(key, obstacles, SCENE_POINTS)
    position, rotation = grip_pose(link_poses(goal))

    def observe(q):
        return Observation(
            joint_position=q,
            joint_velocity=jnp.zeros_like(q),
            goal_joints=goal,
            goal_position=position,
            goal_quaternion=matrix_to_quaternion(rotation),
            scene_points=points,
            scene_mask=mask,
            robot_points=robot_points().world(link_poses(q)),
        )

    def step(state, key):
        q, carry = state
        target, carry = policy.act(observe(q), carry, key)
        q = jnp.clip(target, JOINT_LOWER, JOINT_UPPER)
        return (q, carry), (q, jnp.min(gaps(q, obstacles).obstacle))

    start = demonstration.path[0]
    begun = (start, policy.init(observe(start)))
    _, walked = jax.lax.scan(step, begun, jax.random.split(key, STEPS))
    return walked


def _stray(
    walked: Float[Array, "T 7"],
    room: Float[Array, " T"],
    goal: Float[Array, "7"],
    key: PRNGKeyArray,
) -> tuple[Float[Array, "7"], Bool[Array, ""]]:
    """A configuration to go on from, and whether there is one: free, and not yet at the goal."""
    number = jnp.arange(STEPS)
    touch = jnp.min(jnp.where(room < _TOUCH, number, STEPS))
    arrived = jnp.max(jnp.abs(walked - goal), axis=-1) < _ARRIVED
    last = jnp.minimum(touch, jnp.min(jnp.where(arrived, number, STEPS))) - 1
    which, before, anywhere = jax.random.split(key, 3)
    just_before = (jax.random.uniform(which) < _SHARE_BEFORE) & (touch < STEPS)
    chosen = jnp.where(
        just_before,
        last - jax.random.randint(before, (), 0, _JUST_BEFORE),
        jnp.floor(jax.random.uniform(anywhere) * (last + 1)).astype(jnp.int32),
    )
    return walked[jnp.maximum(chosen, 0)], last >= 0


def _hint(path: Float[Array, "m 7"], q: Float[Array, "7"]) -> Float[Array, "m 7"]:
    """From `q` to a waypoint a little beyond the nearest of the old path, and along it."""
    nearest = jnp.argmin(jnp.max(jnp.abs(path - q), axis=-1))
    return (
        path[jnp.minimum(nearest + _SKIPPED + jnp.arange(len(path)) - 1, len(path) - 1)]
        .at[0]
        .set(q)
    )


@cache
def _strays():
    @partial(jax.vmap, in_axes=(None, 0, 0))
    def one(policy, demonstration, key):
        walk_key, stray_key = jax.random.split(key)
        walked, room = _walk(policy, demonstration, walk_key)
        q, usable = _stray(walked, room, demonstration.goal, stray_key)
        return q, usable, _hint(demonstration.path, q)

    return jit(one)


def correct(policy: Policy, demonstrations: Demonstrations, seed: int) -> Demonstrations:
    """The expert's paths from where `policy` goes astray in each of up to `batch_size()` demonstrations;
    those that it solves."""
    count = demonstrations.count
    filled = jax.tree.map(
        lambda leaf: np.resize(leaf, (batch_size(), *leaf.shape[1:])), demonstrations
    )
    keys = jax.vmap(lambda index: jax.random.fold_in(jax.random.key(seed), index))(filled.index)
    starts, usable, hints = _strays()(policy, filled, keys)
    plans = planner(CHEAP)(filled.obstacles(), starts, filled.goal, keys, hints[:, None])
    good = np.flatnonzero(np.asarray(plans.success & usable)[:count])
    found = replace(filled, path=plans.path, length=plans.length, reached=plans.reached)
    return jax.tree.map(lambda leaf: np.asarray(leaf)[good], found)


def fill_corrections(
    shards: Shards,
    policy: Policy,
    demonstrations: Demonstrations,
    count: int,
    seed: int,
    progress: Callable[[int, int], None],
) -> None:
    """Makes the shards that are not there yet, from the first `count` demonstrations, a multiple of SHARD.

    `progress(walked, corrected)` is told of every batch.
    """
    for first in range(0, count, SHARD):
        if first in shards.done:
            continue
        parts = []
        for begin in range(first, first + SHARD, batch_size()):
            some = jax.tree.map(lambda leaf, b=begin: leaf[b : b + batch_size()], demonstrations)
            parts.append(correct(policy, some, seed))
            progress(some.count, parts[-1].count)
        shards.add(first, join(parts))
