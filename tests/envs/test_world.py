"""The world as pure functions: what a step does, what it reports, and that it compiles once."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from drpbench.compile import jit
from drpbench.contract import EPISODE, ROBOT_POINTS, SCENE_POINTS
from drpbench.envs import TASKS, World
from drpbench.geometry import signed_distance
from drpbench.robot import PANDA

from ..scenes import batch, bodies, boxes, postures, problem

pytestmark = pytest.mark.slow

LANES, STEPS = 8, 20


class Counted:
    """A jitted function that counts how often it is traced."""

    def __init__(self, function):
        self.traces = 0

        def traced(*arguments):
            self.traces += 1
            return function(*arguments)

        self._compiled = jit(traced)

    def __call__(self, *arguments):
        return self._compiled(*arguments)


WORLD = World(TASKS["FDO"])


def _steps(reset, step, observe):
    """An episode's first 20 steps at given targets (20, ..., 7), from control step `clock` on."""

    def run(state, targets, clock):
        def one(state, command):
            target, clock = command
            state, events = step(state, target, clock)
            seen = observe(state)
            return state, (state, events, seen)

        return jax.lax.scan(one, state, (targets, clock + jnp.arange(STEPS)))[1]

    return Counted(reset), Counted(run)


@pytest.fixture(scope="module")
def worlds():
    """`reset` and 20 steps of eight worlds of FDO."""
    return _steps(
        jax.vmap(WORLD.reset),
        jax.vmap(WORLD.step, in_axes=(0, 0, None)),
        jax.vmap(WORLD.observe),
    )


@pytest.fixture(scope="module")
def start(worlds):
    problems, keys = scenes(0)
    return worlds[0](problems, keys)


@pytest.fixture(scope="module")
def targets():
    """Targets that jump about, beyond the joint limits too."""
    rng = np.random.default_rng(1)
    walk = rng.uniform(1.2 * PANDA.joint_lower, 1.2 * PANDA.joint_upper, (STEPS // 5, LANES, 7))
    return np.repeat(walk, 5, axis=0).astype(np.float32)


@pytest.fixture(scope="module")
def run(worlds, start, targets):
    """States, events and observations after each of 20 steps."""
    return worlds[1](start, targets, jnp.int32(0))


def scenes(seed):
    """Eight arms between a box each, the table, and keys."""
    q, goals = postures(LANES, seed), postures(LANES, seed + 100)
    rng = np.random.default_rng(seed)
    table = ((0.5, 0.0, -0.1), (0.5, 0.8, 0.1))
    problems = batch(
        [
            problem(
                q[b],
                goals[b],
                boxes(table, (rng.uniform(-1, 1, 3) + [0, 0, 1], (0.1, 0.1, 0.1))),
                1,
                b,
            )
            for b in range(LANES)
        ]
    )
    return problems, jax.random.split(jax.random.key(seed), LANES)


def same(first, second):
    """Whether two pytrees hold the same bits; random keys by their data."""

    def plain(leaf):
        key = jnp.issubdtype(leaf.dtype, jax.dtypes.prng_key)
        return np.asarray(jax.random.key_data(leaf) if key else leaf)

    return all(
        np.array_equal(plain(a), plain(b), equal_nan=False)
        for a, b in zip(jax.tree.leaves(first), jax.tree.leaves(second), strict=True)
    )


def lanes(tree, index, axis):
    return [np.take(np.asarray(leaf), index, axis) for leaf in jax.tree.leaves(tree)]


def test_reset_is_the_problem_at_rest(start):
    problems, _ = scenes(0)
    np.testing.assert_array_equal(start.joint_position, problems.start)
    np.testing.assert_array_equal(start.reference, problems.start)
    assert not np.asarray(start.joint_velocity).any()
    assert not np.asarray(start.contact_torque).any()


def test_the_same_input_gives_the_same_bits(worlds, start, targets, run):
    again = worlds[0](*scenes(0))
    assert same(again, start)
    assert same(worlds[1](again, targets, jnp.int32(0)), run)


def test_another_key_gives_another_episode(worlds, start):
    problems, _ = scenes(0)
    other = worlds[0](problems, scenes(1)[1])
    differs = np.asarray(other.movers.position) != np.asarray(start.movers.position)
    assert differs.any(axis=(1, 2)).all()
    assert (np.asarray(other.cloud.static_points) != np.asarray(start.cloud.static_points)).any()


def test_nothing_compiles_twice(worlds, targets, run):
    reset, steps = worlds
    for seed, clock in ((2, 0), (3, 690), (4, 990)):
        problems, keys = scenes(seed)
        masked = replace(problems.obstacles, mask=problems.obstacles.mask & (seed != 3))
        problems = replace(problems, obstacles=masked, level=np.full(LANES, 2, np.int32))
        states, _, _ = steps(reset(problems, keys), targets, jnp.int32(clock))
        jax.block_until_ready(states)
    assert (reset.traces, steps.traces) == (1, 1)


def test_order_in_the_batch_changes_no_bit(worlds, start, targets, run):
    order = np.array([5, 2, 7, 0, 1, 6, 3, 4])
    problems, keys = scenes(0)
    shuffled = worlds[0](jax.tree.map(lambda leaf: leaf[order], problems), keys[order])
    states, events, seen = worlds[1](shuffled, targets[:, order], jnp.int32(0))
    expected = lanes((run[0].joint_position, run[1], run[2]), order, 1)
    found = lanes((states.joint_position, events, seen), np.arange(LANES), 1)
    for a, b in zip(found, expected, strict=True):
        np.testing.assert_array_equal(a, b)


def test_one_world_alone_does_what_it_does_among_others(start, targets, run):
    problems, keys = scenes(0)
    reset, steps = _steps(WORLD.reset, WORLD.step, WORLD.observe)
    state = reset(jax.tree.map(lambda leaf: jnp.asarray(leaf[3]), problems), keys[3])
    states, events, seen = steps(state, targets[:, 3], jnp.int32(0))
    close = {"rtol": 0.0, "atol": 1e-4}
    np.testing.assert_allclose(states.joint_position, run[0].joint_position[:, 3], **close)
    np.testing.assert_allclose(events.clearance, run[1].clearance[:, 3], **close)
    np.testing.assert_allclose(events.grip_position, run[1].grip_position[:, 3], **close)
    np.testing.assert_allclose(seen.scene_points, run[2].scene_points[:, 3], **close)
    np.testing.assert_allclose(seen.robot_points, run[2].robot_points[:, 3], **close)


def test_the_servos_follow_at_the_velocity_limits_within_the_joint_limits(start, targets, run):
    reference = np.concatenate([np.asarray(start.reference)[None], run[0].reference]).astype(float)
    most = PANDA.velocity_limit * EPISODE.period
    step = np.diff(reference, axis=0)
    assert (np.abs(step) <= most + 1e-6).all()
    aim = np.clip(targets, PANDA.joint_lower, PANDA.joint_upper)
    before = aim - reference[:-1]
    np.testing.assert_allclose(step, np.clip(before, -most, most), atol=1e-6)
    assert (np.abs(step) > 0.99 * most).mean() > 0.5
    assert (reference >= PANDA.joint_lower - 1e-6).all() and (
        reference <= PANDA.joint_upper + 1e-6
    ).all()


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_a_target_that_is_no_number_is_reported_and_contained(worlds, start, targets, run, bad):
    broken = targets.copy()
    broken[7, 3, 2] = bad
    states, events, seen = worlds[1](start, broken, jnp.int32(0))
    expected = np.ones((STEPS, LANES), bool)
    expected[7, 3] = False
    np.testing.assert_array_equal(events.finite, expected)
    assert np.asarray(run[1].finite).all()
    np.testing.assert_array_equal(states.reference[7, 3], states.reference[6, 3])
    for leaf in jax.tree.leaves((states.joint_position, states.joint_velocity, events, seen)):
        assert np.isfinite(leaf).all()
    others = np.arange(LANES) != 3
    for a, b in zip(lanes((events, seen), others, 1), lanes(run[1:], others, 1), strict=True):
        np.testing.assert_array_equal(a, b)


def test_events_are_those_of_the_arm_as_it_is(run):
    states, events, _ = run
    q = np.asarray(states.joint_position).reshape(-1, 7)
    _, grip, _, apart = bodies(q)
    np.testing.assert_allclose(np.asarray(events.grip_position).reshape(-1, 3), grip, atol=1e-6)
    np.testing.assert_allclose(np.asarray(events.self_clearance).ravel(), apart, atol=2e-6)
    rotation = np.asarray(events.grip_rotation)
    unit = np.einsum("...ij,...kj->...ik", rotation, rotation)
    np.testing.assert_allclose(unit, np.broadcast_to(np.eye(3), unit.shape), atol=1e-5)


def test_clearance_is_to_the_nearest_obstacle_at_rest(worlds, start):
    held = np.tile(np.asarray(start.joint_position), (STEPS, 1, 1))
    states, events, _ = worlds[1](start, held, jnp.int32(0))

    def brute(state):
        centers = PANDA.moving_spheres.world(PANDA.link_poses(state.joint_position))
        gap = signed_distance(centers, WORLD.obstacles(state)) - PANDA.moving_spheres.radius
        return jnp.min(gap), jnp.argmin(gap)

    clearance, sphere = jit(jax.vmap(brute))(jax.tree.map(lambda leaf: leaf[-1], states))
    free = np.asarray(events.clearance[-1]) > 0.0
    assert free.sum() >= 4
    np.testing.assert_allclose(events.clearance[-1][free], clearance[free], atol=1e-5)
    np.testing.assert_array_equal(events.sphere[-1][free], sphere[free])


def test_what_is_seen_is_the_problem_and_the_arm(start, run):
    states, _, seen = run
    problems, _ = scenes(0)
    for name in ("goal_position", "goal_quaternion"):
        stacked = np.repeat(getattr(problems, name)[None], STEPS, axis=0)
        np.testing.assert_array_equal(getattr(seen, name), stacked)
    np.testing.assert_array_equal(seen.goal_joints[5], problems.goal)
    np.testing.assert_array_equal(seen.joint_position, states.joint_position)
    np.testing.assert_array_equal(seen.joint_velocity, states.joint_velocity)
    assert seen.scene_points.shape == (STEPS, LANES, SCENE_POINTS, 3)
    assert seen.robot_points.shape == (STEPS, LANES, ROBOT_POINTS, 3)
    skin = jit(jax.vmap(lambda q: PANDA.surface_points(ROBOT_POINTS).world(PANDA.link_poses(q))))(
        states.joint_position[-1]
    )
    np.testing.assert_allclose(seen.robot_points[-1], skin, atol=1e-6)
    assert seen.obstacles is None


def test_static_points_never_change_and_moving_ones_go_with_their_box(run):
    states, _, seen = run
    points, mask = np.asarray(seen.scene_points), np.asarray(seen.scene_mask)
    static = states.cloud.static_points.shape[2]
    each = states.cloud.mover_tickets.shape[3]
    np.testing.assert_array_equal(
        points[:, :, :static], np.repeat(points[:1, :, :static], STEPS, 0)
    )
    np.testing.assert_array_equal(mask[:, :, :static], np.repeat(mask[:1, :, :static], STEPS, 0))
    position = np.asarray(states.movers.position)
    moved = np.diff(points[:, :, static:].reshape(STEPS, LANES, 3, each, 3), axis=0)
    kept = mask[:, :, static:].reshape(STEPS, LANES, 3, each)
    kept = kept[1:] & kept[:-1]
    expected = np.broadcast_to(np.diff(position, axis=0)[:, :, :, None], moved.shape)
    np.testing.assert_allclose(moved[kept], expected[kept], atol=5e-7)
    assert np.abs(expected[kept]).max() > 1e-3


def test_only_a_privileged_policy_sees_the_obstacles(start):
    observe = jit(jax.vmap(lambda state: WORLD.observe(state, privileged=True)))
    found = observe(start).obstacles
    problems, _ = scenes(0)
    assert found.mask.shape == (LANES, 2 + 3)
    np.testing.assert_array_equal(found.position[:, :2], problems.obstacles.position)
    np.testing.assert_array_equal(found.position[:, 2:], start.movers.position)
    np.testing.assert_array_equal(found.mask[:, 2:], start.movers.active)


@pytest.mark.parametrize("task", TASKS)
def test_a_state_keeps_its_types_so_that_a_step_compiles_once(task):
    world = World(TASKS[task])

    def two(problem, key):
        state = world.reset(problem, key)
        later, _ = world.step(state, problem.start, jnp.int32(0))
        return jax.tree.leaves(state), jax.tree.leaves(later)

    for pair in zip(*jax.eval_shape(two, problem(), jax.random.key(0)), strict=True):
        before, after = ((leaf.shape, leaf.dtype, leaf.weak_type) for leaf in pair)
        assert before == after
