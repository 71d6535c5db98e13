"""The trajectory optimiser as a policy: it goes round, and plans anew where its way is taken."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from drpbench.baselines import TrajOpt
from drpbench.compile import jit
from drpbench.geometry import BOX, Primitives
from drpbench.learning.batches import cloud
from drpbench.planning.clearance_cost import gaps
from drpbench.planning.expert import PlannerSettings
from drpbench.robot import PANDA

from ..scenes import observation

pytestmark = pytest.mark.slow

SMALL = PlannerSettings(iterations=15, vias=9, stop_short=True)
POLICY = TrajOpt(first=SMALL, again=SMALL)
START = np.asarray(PANDA.home, np.float32)
GOAL = START + np.float32([1.4, 0, 0, 0, 0, 0, 0])
LANES = 2
AWAY = float(jnp.hypot(*PANDA.grip_pose(PANDA.link_poses(jnp.asarray(START)))[0][:2]))
"""[m] of the hand from the base's axis"""


def post(bearing, away=AWAY):
    """A post that stands in the way of the hand, at this bearing [rad]."""
    return Primitives(
        kind=jnp.array([BOX]),
        half_size=jnp.array([[0.03, 0.03, 0.35]]),
        position=jnp.array([[away * np.cos(bearing), away * np.sin(bearing), 0.35]]),
        rotation=jnp.eye(3)[None],
        mask=jnp.ones(1, bool),
    )


def seen(q, obstacles):
    return replace(observation(jnp.asarray(q), jnp.asarray(GOAL)), obstacles=obstacles)


def batch(one):
    return jax.tree.map(lambda leaf: jnp.stack([leaf] * LANES), one)


@pytest.fixture(scope="module")
def compiled():
    init = jit(jax.vmap(POLICY.init))
    act = jit(jax.vmap(lambda seen, carry: POLICY.act(seen, carry, None)))
    return init, act


least = jax.jit(lambda q, obstacles: jnp.min(gaps(q, obstacles).obstacle))


def walk(compiled, obstacles_at, steps=400):
    """Where the arm is at each step, if it is always where it is told to be, and its room there."""
    init, act = compiled
    q, way = START, []
    carry = init(batch(seen(q, obstacles_at(0))))
    for step in range(steps):
        obstacles = obstacles_at(step)
        target, carry = act(batch(seen(q, obstacles)), carry)
        np.testing.assert_array_equal(target[0], target[1])
        q = np.asarray(target[0])
        way.append((q, float(least(jnp.asarray(q), obstacles))))
    return way, carry


def test_it_goes_round_what_stands_there(compiled):
    assert POLICY.privileged
    way, carry = walk(compiled, lambda step: post(0.7))
    straight = START + 0.5 * (GOAL - START)
    assert float(least(jnp.asarray(straight), post(0.7))) < 0.0  # it is in the way
    assert min(room for _, room in way) > 0.0
    np.testing.assert_allclose(way[-1][0], GOAL, atol=1e-3)
    assert bool(carry.reached[0]) and int(carry.clock[0]) == len(way)
    speed = np.abs(np.diff([q for q, _ in way], axis=0)) * 60 / PANDA.velocity_limit
    assert speed.max() < 0.75  # half of the limits, and a little for the samples


def test_it_plans_anew_where_its_way_is_taken(compiled):
    far, near = post(-2.0), post(1.1)
    way, _ = walk(compiled, lambda step: far if step < 20 else near)
    assert min(room for _, room in way[35:]) > 0.0
    untouched, _ = walk(compiled, lambda step: far)
    assert np.abs(way[-1][0] - untouched[60][0]).max() > 0.05  # it did not stay where it was
    beside = [np.abs(a - b).max() for (a, _), (b, _) in zip(way, untouched, strict=True)]
    assert max(beside[:20]) < 1e-6 and max(beside) > 0.1  # another way than without the post


def test_before_a_goal_that_is_taken_it_stops_and_goes_on_when_it_is_free(compiled):
    taken, free = post(1.4), post(-2.0)
    way, _ = walk(compiled, lambda step: taken if step < 300 else free, steps=600)
    assert min(room for _, room in way) > 0.0
    assert np.abs(way[290][0] - GOAL).max() > 0.05
    np.testing.assert_allclose(way[-1][0], GOAL, atol=1e-3)


def test_without_privilege_it_goes_round_what_the_cloud_shows():
    """The post again, as points on its faces; which it sees alone."""
    few = PlannerSettings(iterations=15, vias=3)
    policy = replace(POLICY, privileged=False, first=few)
    wanted = replace(observation(jnp.asarray(START), jnp.asarray(GOAL)), obstacles=None)
    points, mask = cloud(jax.random.key(0), post(0.7), wanted.scene_points.shape[0])
    carry = jit(policy.init)(replace(wanted, scene_points=points, scene_mask=mask))
    assert bool(carry.reached) and float(carry.room) > 0.0
    np.testing.assert_allclose(carry.q[-1], GOAL, atol=1e-5)
    assert min(float(least(q, post(0.7))) for q in carry.q[::8]) > 0.0
