"""The two floors: standing still, and the straight line."""

from dataclasses import replace

import jax
import numpy as np
import pytest

from drpbench.compile import jit
from drpbench.policies import Hold, Straight
from drpbench.robot import PANDA

from ..scenes import observation, postures

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


def test_neither_sees_the_scene(act):
    q = postures(2)
    empty = observation(q[0], q[1])
    crowded = replace(empty, scene_points=empty.scene_points + 0.3, scene_mask=~empty.scene_mask)
    for policy in (Hold(), Straight()):
        found = [act(policy, seen, policy.init(seen))[0] for seen in (empty, crowded)]
        np.testing.assert_array_equal(*found)
