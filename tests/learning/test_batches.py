"""What the network is shown is what the world shows, and what it is asked for leads along the
path."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from drpbench.contract import EPISODE
from drpbench.geometry import signed_distance
from drpbench.learning import batches
from drpbench.planning.clearance_cost import gaps
from drpbench.policies.networks.chunks import CHUNK, SPEED, decode
from drpbench.robot import PANDA

cloud = jax.jit(lambda key, obstacles: batches.cloud(key, obstacles, 512))


@pytest.fixture(scope="module")
def batch(demonstrations):
    return jax.jit(lambda key: batches.sample(key, demonstrations, 128, 512))(jax.random.key(3))


def test_the_way_left_solves_its_differential_equation():
    step, left = 1e-4, 0.5
    walked = [left]
    for _ in range(30000):
        left -= step * SPEED * min(1.0, left / batches.near())
        walked.append(left)
    times = jnp.arange(0, 30001, 1000) * step
    closed = batches.way_left(jnp.full(len(times), 0.5), times)
    assert np.allclose(closed, np.array(walked)[::1000], atol=1e-4)


def test_places_along_a_path_are_between_its_waypoints():
    path = jnp.cumsum(jnp.ones((5, 7)), axis=0)
    found = batches.along(path, jnp.array([0.0, 0.125, 1.0, 1.5, -1.0]))
    assert np.allclose(found[:, 0], [1.0, 1.5, 5.0, 5.0, 1.0])


def test_points_lie_on_obstacles_above_the_table(batch):
    above = jax.jit(lambda points, scene: signed_distance(points, scene))
    for b in range(8):
        # A scene that is mostly table has fewer: what is under its top is not seen.
        there = np.asarray(batch.scene_mask[b])
        assert there.mean() > 0.4
        points = np.asarray(batch.scene_points[b])
        scene = jax.tree.map(lambda leaf, b=b: np.asarray(leaf)[b], batch.obstacles)
        # Inside: on another one.
        assert np.asarray(above(points, scene))[there].max() < 1e-4
        points = points[there]
        if float(scene.position[0, 2] + scene.half_size[0, 2]) > -1e-4:  # there is a ground
            assert float(points[:, 2].min()) >= -1e-5


def test_robot_points_are_those_of_the_joints_shown(batch):
    surface = PANDA.surface
    shown = jax.jit(lambda q: surface.world(PANDA.link_poses(q)))
    for b in range(4):
        everywhere = shown(batch.joints[b])
        gaps = jnp.linalg.norm(batch.robot_points[b][:, None] - everywhere[None], axis=-1)
        assert float(gaps.min(axis=1).max()) < 1e-5


def test_chunks_lead_at_no_more_than_the_stated_speed_along_the_path(demonstrations):
    """Without an offset the ten waypoints are on the path, forward, and no faster than SPEED."""
    rows = []
    for share in (0.0, 0.3, 0.9, 1.0):
        path, length = jnp.asarray(demonstrations.path[0]), float(demonstrations.length[0])
        left = length * (1 - share)
        times = EPISODE.period * jnp.arange(CHUNK + 1)
        ahead = batches.along(path, 1 - batches.way_left(jnp.full(CHUNK + 1, left), times) / length)
        speed = (
            jnp.max(jnp.abs(jnp.diff(ahead, axis=0)) / PANDA.velocity_limit, axis=1)
            / EPISODE.period
        )
        rows.append(np.asarray(speed))
    assert np.allclose(rows[0], SPEED, rtol=0.02)  # full speed
    assert np.all(np.diff(rows[2]) <= 1e-3)  # slowing down
    assert np.allclose(rows[3], 0.0)  # at rest


def test_targets_stay_near_the_arm_and_within_its_limits(batch):
    waypoints = decode(batch.chunk, batch.joints, batch.goal)
    moved = jnp.abs(waypoints - batch.joints[:, None]) / PANDA.velocity_limit
    assert float(moved.max()) < 0.3  # [s at the velocity limits], a way back from beside the path
    assert bool(
        jnp.all(waypoints > PANDA.joint_lower - 1e-3)
        & jnp.all(waypoints < PANDA.joint_upper + 1e-3)
    )
    assert bool(jnp.isfinite(batch.chunk).all())


def test_the_same_key_draws_the_same_batch(batch, demonstrations):
    again = jax.jit(lambda key: batches.sample(key, demonstrations, 128, 512))(jax.random.key(3))
    for a, b in zip(jax.tree.leaves(batch), jax.tree.leaves(again), strict=True):
        assert np.array_equal(a, b)


def test_clouds_without_obstacles_are_empty(demonstrations):
    scene = jax.tree.map(lambda leaf: leaf[0], demonstrations.obstacles.primitives())
    bare = jax.tree.map(jnp.asarray, scene)
    bare = type(scene)(bare.kind, bare.half_size, bare.position, bare.rotation, bare.mask & False)
    points, there = cloud(jax.random.key(0), bare)
    assert not bool(there.any()) and not np.asarray(points).any()


def test_some_clouds_are_denser_on_some_obstacles(demonstrations):
    """The share of points on an obstacle varies more between clouds than chance alone would have
    it."""
    scene = jax.tree.map(lambda leaf: jnp.asarray(leaf[0]), demonstrations.obstacles.primitives())
    keys = jax.random.split(jax.random.key(0), 64)
    high = jnp.mean(jax.vmap(lambda key: cloud(key, scene)[0])(keys)[..., 2] > 0.02, axis=1)
    mean = float(high.mean())
    assert float(high.std()) > 2.0 * np.sqrt(mean * (1 - mean) / 512)


def test_the_world_is_turned_with_the_arm(demonstrations):
    """Turned by as much as joint 1, everything is as far from the arm as before."""
    scene = jax.tree.map(lambda leaf: leaf[0], demonstrations.obstacles.primitives())
    q, angle = demonstrations.path[0, 20], jnp.float32(0.7)
    room = jax.jit(lambda q, scene: gaps(q, scene).obstacle)
    before = room(q, scene)
    after = room(q.at[0].add(angle), jax.jit(batches.turned)(scene, angle))
    np.testing.assert_allclose(after, before, atol=1e-5)
    assert batches._turns(PANDA)


def test_samples_are_turned_and_walked_back_and_look_for_little_room(demonstrations, batch):
    goals = np.asarray(demonstrations.goal)
    starts = np.asarray(demonstrations.path[:, 0])

    def same(goal, ends):  # all but joint 1, which turning moves
        return (np.abs(ends[:, 1:] - goal[1:]).max(axis=1) < 1e-5).any()

    forward = np.array([same(goal, goals) for goal in np.asarray(batch.goal)])
    backward = np.array([same(goal, starts) for goal in np.asarray(batch.goal)])
    assert (forward | backward).all() and 0.3 < backward.mean() < 0.7
    turned = [np.abs(goals - goal).max(axis=1).min() > 1e-3 for goal in np.asarray(batch.goal)]
    assert np.mean(turned) > 0.5
    assert np.all(np.asarray(batch.goal) >= PANDA.joint_lower)
    assert np.all(np.asarray(batch.goal) <= PANDA.joint_upper)

    def least(q, scene):
        return jnp.min(gaps(q, scene).obstacle)

    room = jax.jit(jax.vmap(least))(batch.joints, batch.obstacles)
    everywhere = jax.jit(jax.vmap(jax.vmap(least, (0, None))))(
        demonstrations.path, demonstrations.obstacles.primitives()
    )
    little = float((everywhere < batches.TIGHT).mean())
    assert float((room < batches.TIGHT).mean()) > little + 0.1


def test_below_the_ground_nothing_is_seen_and_without_ground_all_is(demonstrations):
    scene = jax.tree.map(lambda leaf: leaf[0], demonstrations.obstacles.primitives())
    key = jax.random.key(0)
    points, there = cloud(key, scene)
    assert float(jnp.where(there, points[:, 2], 0.0).min()) >= -1e-5
    lower = replace(scene, position=scene.position - jnp.array([0.0, 0.0, 0.1]))
    points, there = cloud(key, lower)
    assert bool(there.all()) and float(points[:, 2].min()) < -0.1
