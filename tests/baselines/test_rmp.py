"""RMP: gives way to points, reaches goals, keeps within the limits."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from drpbench.baselines import Rmp
from drpbench.compile import jit
from drpbench.contract import Policy
from drpbench.envs import TASKS, World
from drpbench.robot import PANDA

from ..scenes import batch, bodies, observation, postures, problem

KEY = jax.random.key(0)
LANES, STEPS = 8, 600


@pytest.fixture(scope="module")
def act():
    return jit(lambda policy, seen: policy.act(seen, policy.init(seen), KEY)[0])


@pytest.fixture(scope="module")
def drive():
    """Eight arms under `rmp` for 10 s: joint positions (600, 8, 7) and grip positions."""
    world = World(TASKS["SE"])

    def episode(policy, problems):
        def step(states, clock):
            def one(state):
                target, _ = policy.act(world.observe(state), (), KEY)
                state, events = world.step(state, target, clock)
                return state, (state.joint_position, events.grip_position)

            return jax.vmap(one)(states)

        states = jax.vmap(lambda problem: world.reset(problem, KEY))(problems)
        return jax.lax.scan(step, states, jnp.arange(STEPS))[1]

    return jit(episode)


def test_it_is_a_policy():
    assert isinstance(Rmp(), Policy) and not Rmp().privileged


def test_it_goes_for_the_goal_where_there_is_nothing(act):
    for start, goal in zip(postures(10), postures(10, 1), strict=True):
        step = np.asarray(act(Rmp(), observation(start, goal))) - start
        away = goal - start
        assert step @ away > 0.9 * np.linalg.norm(step) * np.linalg.norm(away)


def test_it_is_pushed_away_from_a_point_that_it_closes_on(act):
    """With a point 2 cm before a sphere, the arm turns away from it, compared to without."""
    model = PANDA.moving_spheres
    centers_of = jit(jax.vmap(jax.jacfwd(lambda q: model.world(PANDA.link_poses(q)))))
    q = postures(24, seed=2)
    centers, jacobians = bodies(q)[0], np.asarray(centers_of(q))
    rng = np.random.default_rng(0)
    for b in range(24):
        sphere = rng.choice(np.nonzero(model.frame >= 4)[0])
        outward = rng.normal(size=3)
        outward /= np.linalg.norm(outward)
        point = centers[b, sphere] + outward * (model.radius[sphere] + 0.02)
        gaps = np.linalg.norm(point - centers[b], axis=1) - model.radius
        closest = gaps.argmin()
        normal = centers[b, closest] - point
        normal /= np.linalg.norm(normal)
        row = normal @ jacobians[b, closest]
        velocity = -0.3 * row / np.linalg.norm(row)  # towards the point
        free = act(Rmp(), observation(q[b], velocity=velocity))
        pushed = act(Rmp(), observation(q[b], velocity=velocity, points=[point]))
        if gaps[closest] > 0.0:
            assert row @ (np.asarray(pushed) - np.asarray(free)) > 0.0


def test_a_masked_point_is_not_there(act):
    q = postures(1)[0]
    empty = observation(q, q + np.float32(0.1))
    crowded = observation(q, q + np.float32(0.1), points=np.tile(bodies(q)[0][0][40], (2048, 1)))
    masked = replace(crowded, scene_mask=empty.scene_mask)
    np.testing.assert_array_equal(act(Rmp(), masked), act(Rmp(), empty))


@pytest.mark.parametrize("crowd", ["none", "inside", "on the centres"])
def test_targets_are_finite_and_within_reach_of_the_velocity_limits(act, crowd):
    rng = np.random.default_rng(0)
    for b, q in enumerate(postures(10, seed=4)):
        velocity = rng.uniform(-1.0, 1.0, 7) * PANDA.velocity_limit
        centers = bodies(q)[0][0]
        points = {
            "none": (),
            "inside": centers + rng.normal(0.0, 0.01, centers.shape),
            "on the centres": centers,
        }[crowd]
        goal = postures(1, seed=b)[0]
        target = np.asarray(act(Rmp(), observation(q, goal, velocity, points)))
        assert np.isfinite(target).all()
        assert (np.abs(target - q) <= PANDA.velocity_limit * PANDA.servo_lag + 1e-5).all()


def test_it_holds_back_from_a_joint_limit(act):
    """Less so without its leaf for the limits. The goal is beyond."""
    for limit, sign in ((PANDA.joint_lower, -1.0), (PANDA.joint_upper, 1.0)):
        q = (limit - sign * 1e-3).astype(np.float32)
        seen = observation(q, limit + sign * 0.5)
        free, held = (sign * (np.asarray(act(rmp, seen)) - q) for rmp in (Rmp(mu_l=0.0), Rmp()))
        assert (free > 0.0).all()
        assert (held < free).all()


@pytest.mark.slow
def test_it_reaches_free_goals_and_keeps_the_joint_limits(drive):
    start = postures(LANES, seed=5)
    away = np.random.default_rng(5).uniform(-1.5, 1.5, start.shape)
    goal = np.clip(start + away, PANDA.joint_lower + 0.1, PANDA.joint_upper - 0.1)
    problems = batch([problem(a, b) for a, b in zip(start, goal, strict=True)])
    joints, grip = (np.asarray(a) for a in drive(Rmp(), problems))
    assert np.isfinite(joints).all()
    assert np.linalg.norm(grip[0] - problems.goal_position, axis=1).min() > 0.1
    assert np.linalg.norm(grip[-1] - problems.goal_position, axis=1).max() < 0.01
    assert (joints > PANDA.joint_lower - 1e-3).all() and (joints < PANDA.joint_upper + 1e-3).all()
