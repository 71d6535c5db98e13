"""Trivial baselines: standing still, the straight line, waiting folded away."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from drpbench.compile import jit
from drpbench.contract import EPISODE
from drpbench.envs import TASKS
from drpbench.policies import FoldAndWait, Hold, Straight
from drpbench.policies.floors import FOLDED
from drpbench.robot import PANDA

from ..scenes import bodies, observation, postures

KEY = jax.random.key(0)


@pytest.fixture(scope="module")
def act():
    """`act` with the policy as an argument, as the runner calls it."""
    return jit(lambda policy, seen, carry: policy.act(seen, carry, KEY))


def test_hold_stays_where_the_episode_began(act):
    first, later = (observation(q, goal=PANDA.home) for q in postures(2))
    carry = Hold().init(first)
    target, carry = act(Hold(), first, carry)
    np.testing.assert_array_equal(target, first.joint_position)
    target, _ = act(Hold(), later, carry)
    np.testing.assert_array_equal(target, first.joint_position)


@pytest.mark.parametrize("speed", [0.3, 0.5, 1.0])
def test_straight_aims_along_the_line_at_its_share_of_the_velocity_limits(act, speed):
    policy = Straight(speed)
    q = postures(20)
    for start, goal in zip(q[:10], q[10:], strict=True):
        seen = observation(start, goal)
        target, _ = act(policy, seen, policy.init(seen))
        step, away = np.asarray(target) - start, goal - start
        np.testing.assert_allclose(
            step / np.linalg.norm(step), away / np.linalg.norm(away), atol=1e-5
        )
        # What the servos make of it: a velocity of step / lag.
        paces = np.abs(step) / PANDA.servo_lag / PANDA.velocity_limit
        assert np.abs(away / PANDA.velocity_limit).max() > speed * PANDA.servo_lag
        assert paces.max() == pytest.approx(speed, rel=1e-4)


def test_straight_aims_at_the_goal_itself_once_it_is_near(act):
    q = postures(2)[0]
    near = q + 0.01 * PANDA.velocity_limit * np.float32([1, -1, 1, 0, -1, 1, -1])
    for goal in (q, near.astype(np.float32)):
        seen = observation(q, goal)
        target, _ = act(Straight(), seen, ())
        np.testing.assert_allclose(target, goal, atol=1e-6)


def test_none_of_them_sees_the_scene(act):
    q = postures(2)
    empty = observation(q[0], q[1])
    crowded = replace(empty, scene_points=empty.scene_points + 0.3, scene_mask=~empty.scene_mask)
    for policy in (Hold(), Straight(), FoldAndWait()):
        found = [act(policy, seen, policy.init(seen))[0] for seen in (empty, crowded)]
        np.testing.assert_array_equal(*found)


def test_it_waits_folded_until_every_box_is_gone_and_then_goes_straight(act):
    policy, seen = FoldAndWait(), observation(*postures(2))
    last = max(EPISODE.steps - task.removal for task in TASKS.values() if task.removal)
    assert last * EPISODE.period == pytest.approx(policy.wait)
    away, _ = act(policy, seen, np.int32(last - 1))
    folding, _ = act(Straight(1.0), replace(seen, goal_joints=jnp.asarray(FOLDED)), ())
    np.testing.assert_array_equal(away, folding)
    target, carry = act(policy, seen, np.int32(last))
    np.testing.assert_array_equal(target, act(Straight(1.0), seen, ())[0])
    assert carry == last + 1


def test_folded_it_is_behind_all_boxes_and_touches_nothing():
    centers, _, _, apart = bodies(FOLDED)
    radius = PANDA.moving_spheres.radius
    assert apart[0] > 0.01 and (centers[0, :, 2] - radius).min() > 0.05
    assert (centers[0, :, 0] + radius).max() < 0.08
    assert (np.hypot(*centers[0, :, :2].T) + radius).max() < 0.28
