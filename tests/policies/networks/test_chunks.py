"""The meaning of a chunk: both directions are inverse, and the units are what the formula says."""

import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from drpbench.policies.networks.chunks import (
    CHUNK,
    FLOOR,
    RAMP,
    SPEED,
    commanded,
    decode,
    encode,
    lookahead,
    scale,
)
from drpbench.robot import PANDA

LOWER, UPPER = PANDA.joint_lower.astype(np.float32), PANDA.joint_upper.astype(np.float32)
shares = arrays(np.float32, 7, elements=st.floats(0, 1, width=32))
distances = st.floats(0, 6, width=32)


def joints(share):
    return LOWER + share * (UPPER - LOWER)


@settings(deadline=None, max_examples=200)
@given(
    shares,
    shares,
    distances,
    arrays(np.float32, (CHUNK, 7), elements=st.floats(-3, 3, width=32)),
)
def test_decode_undoes_encode_and_the_other_way_round(a, b, distance, chunk):
    q = joints(a)
    goal = jnp.asarray(q + np.float32(distance) * (b - np.float32(0.5)))
    q = jnp.asarray(q)
    waypoints = decode(jnp.asarray(chunk), q, goal)
    # Waypoints are rounded to float32, which the units magnify.
    unit = CHUNK * SPEED / 60 * np.float32(scale(q, goal))
    again = encode(waypoints, q, goal)
    np.testing.assert_allclose(again, chunk, atol=1e-5 + 1e-5 / unit, rtol=1e-5)
    np.testing.assert_allclose(decode(again, q, goal), waypoints, atol=1e-5)


def test_a_chunk_of_ones_moves_at_the_demonstrations_speed():
    q = jnp.asarray([0.1, -0.2, 0.3, -1.5, 0.2, 1.0, 0.4])
    waypoints = np.asarray(decode(jnp.ones((CHUNK, 7)), q, q + 1.0))
    steps = np.diff(np.concatenate([q[None], waypoints]), axis=0)
    np.testing.assert_allclose(
        steps * 60, np.tile(0.4 * PANDA.velocity_limit, (CHUNK, 1)), rtol=1e-3
    )


def test_the_farthest_joint_sets_the_scale():
    q = jnp.zeros(7)
    assert scale(q, q.at[3].set(-5.0)) == 1.0
    assert scale(q, q.at[3].set(-RAMP)) == 1.0
    np.testing.assert_allclose(scale(q, q.at[3].set(-0.1).at[0].set(0.05)), 0.1 / RAMP, rtol=1e-6)
    np.testing.assert_allclose(scale(q, q), FLOOR)


def test_the_waypoint_commanded_is_as_far_ahead_as_the_servos_lag():
    assert PANDA.servo_lag == pytest.approx(lookahead() / 60)
    rng = np.random.default_rng(0)
    chunk = jnp.asarray(rng.normal(size=(5, CHUNK, 7)), jnp.float32)
    q, goal = jnp.asarray(rng.uniform(-1, 1, (2, 5, 7)), jnp.float32)
    np.testing.assert_array_equal(commanded(chunk, q, goal), decode(chunk, q, goal)[:, 2])


def test_the_same_error_moves_the_arm_less_near_the_goal():
    """Following any chunk whose first joint heads for the goal, the arm does not leave it."""
    q, goal = jnp.full(7, 0.5), jnp.zeros(7)
    wrong = jnp.asarray(np.random.default_rng(0).uniform(-0.3, 0.3, (300, 7)), jnp.float32)
    for error in wrong:
        unit = jnp.asarray(SPEED * PANDA.velocity_limit / 60, jnp.float32)
        towards = (goal - q) / jnp.max(jnp.abs(goal - q))
        chunk = jnp.tile(towards + error, (CHUNK, 1))
        q = q + jnp.clip(commanded(chunk, q, goal) - q, -unit, unit)
    assert float(jnp.abs(q).max()) < 1e-3
