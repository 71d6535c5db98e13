"""MPPI: straight to a free goal, round what stands, away from what comes, and back."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from drpbench.baselines import Mppi
from drpbench.compile import jit
from drpbench.contract import Policy
from drpbench.planning.clearance_cost import gaps
from drpbench.robot import PANDA

from ..scenes import boxes, observation

pytestmark = pytest.mark.slow

START = np.asarray(PANDA.home, np.float32)
GOAL = START + np.float32([1.2, 0, 0, 0, 0, 0, 0])
STEPS, VANISHES = 420, 330
KEYS = jax.random.split(jax.random.key(1), STEPS)
SIZE = (0.05, 0.05, 0.05)


def _hand(q):
    return np.asarray(PANDA.grip_pose(PANDA.link_poses(jnp.asarray(q)))[0])


def _surface(center):
    """(200, 3) points on a box about `center`."""
    rng = np.random.default_rng(0)
    unit = rng.uniform(-1, 1, (200, 3))
    unit[np.arange(200), rng.integers(3, size=200)] = rng.choice([-1.0, 1.0], 200)
    return center + 0.05 * unit


@pytest.fixture(scope="module", params=[False, True], ids=["points", "models"])
def driven(request):
    """Joints (STEPS, 7) of an ideal arm under the policy, the box at `places` (STEPS, 3) [m] and
    there where `there`."""
    policy = Mppi(privileged=request.param)
    model = jax.tree.map(jnp.asarray, boxes(((0.0, 0.0, 0.0), SIZE)))
    base = jax.tree.map(jnp.asarray, observation(START, GOAL, points=_surface(np.zeros(3))))

    def seen(q, place, there):
        points, mask = base.scene_points + place, base.scene_mask & there
        moved = replace(
            model, position=model.position.at[0].set(place), mask=model.mask.at[0].set(there)
        )
        obstacles = moved if request.param else None
        return replace(
            base, joint_position=q, scene_points=points, scene_mask=mask, obstacles=obstacles
        )

    @jit
    def drive(places, there):
        def step(worlds, now):
            q, carry = worlds
            place, there, key = now
            target, carry = policy.act(seen(q, place, there), carry, key)
            most = jnp.asarray(PANDA.velocity_limit, jnp.float32) / 60
            q = q + jnp.clip((target - q) / (60 * PANDA.servo_lag), -most, most)
            return (q, carry), q

        carry = policy.init(seen(jnp.asarray(START), places[0], there[0]))
        return jax.lax.scan(step, (jnp.asarray(START), carry), (places, there, KEYS))[1]

    def run(places, there):
        return np.asarray(drive(jnp.asarray(places, jnp.float32), jnp.asarray(there)))

    return run


def _room(way, places, there):
    """[m] smallest clearance of the arm on its way."""
    shown = [k for k in range(0, len(way), 6) if there[k]]
    return float(_clearances(jnp.asarray(way[shown]), jnp.asarray(places[shown])).min())


@jit
def _clearances(way, places):
    model = jax.tree.map(jnp.asarray, boxes(((0.0, 0.0, 0.0), SIZE)))

    def one(q, place):
        box = replace(model, position=model.position.at[0].set(place))
        return gaps(q, box).obstacle.min()

    return jax.vmap(one)(way, places)


def test_they_are_policies():
    assert isinstance(Mppi(), Policy) and not Mppi().privileged
    assert Mppi(privileged=True).privileged


def test_a_free_goal_is_reached_and_kept_without_noise(driven):
    way = driven(np.zeros((STEPS, 3)), np.zeros(STEPS, bool))
    np.testing.assert_allclose(way[-1], GOAL, atol=2e-3)
    assert np.abs(np.diff(way[-60:], axis=0)).max() < 1e-4
    straight = (way - START) @ (GOAL - START) / np.sum((GOAL - START) ** 2)
    assert np.abs(way - START - straight[:, None] * (GOAL - START)).max() < 0.2


def test_it_goes_round_what_stands_on_its_way(driven):
    middle = _hand((START + GOAL) / 2)
    places, there = np.tile(middle, (STEPS, 1)), np.ones(STEPS, bool)
    assert _room((START + np.linspace(0, 1, 60)[:, None] * (GOAL - START)), places, there) < 0
    way = driven(places, there)
    assert _room(way, places, there) > 0.0
    np.testing.assert_allclose(way[-1], GOAL, atol=0.02)


def test_it_gives_way_to_what_comes_and_returns(driven):
    """A box flies through the goal at 0.3 m/s, back and forth, and vanishes."""
    time = np.arange(STEPS) / 60
    swing = 0.5 * np.cos(2 * np.pi * time / 4.0)
    places = _hand(GOAL) + np.stack([0 * time, 0 * time, swing], 1)
    there = np.arange(STEPS) < VANISHES
    assert _room(np.tile(GOAL, (STEPS, 1)), places, there) < 0
    way = driven(places, there)
    assert _room(way, places, there) > 0.0
    np.testing.assert_allclose(way[-1], GOAL, atol=5e-3)
