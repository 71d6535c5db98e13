"""Lengths by brute force; limits by finite differences of finely sampled trajectories."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.interpolate import CubicSpline

from drpbench.compile import jit
from drpbench.planning.retiming import retime, uniform
from drpbench.planning.spline import natural_slopes
from drpbench.robot import PANDA

COUNT = 256


def length(path):
    return (np.abs(np.diff(path, axis=0)) / PANDA.velocity_limit).max(axis=1).sum()


def walk(seed, waypoints=64, stretch=1.0):
    """A smooth path: low harmonics of random sizes."""
    rng = np.random.default_rng(seed)
    s = np.linspace(0.0, 1.0, waypoints)[:, None, None]
    harmonics = np.arange(1, 4)[:, None]
    sizes = rng.normal(0, 0.5, (3, 7)) / harmonics
    path = PANDA.home + stretch * (
        np.sin(np.pi * s * harmonics) * sizes + s * rng.normal(0, 1, 7)
    ).sum(1)
    return path.astype(np.float32)


_uniform = jax.jit(uniform, static_argnums=1)
_retime = jit(jax.vmap(lambda path: retime(path, COUNT)))


@given(
    arrays(np.float32, (6, 7), elements=st.floats(-2.75, 2.75, width=32)),
    st.lists(st.booleans(), min_size=5, max_size=5),
)
@settings(max_examples=50, deadline=None)
def test_uniform_steps_are_even_and_stay_on_the_line(path, still):
    for i, repeated in enumerate(still):
        if repeated:
            path[i + 1] = path[i]
    points, whole = (np.asarray(x) for x in _uniform(jnp.asarray(path), 33))
    assert whole == pytest.approx(length(path), rel=1e-5, abs=1e-6)
    np.testing.assert_array_equal(points[[0, -1]], path[[0, -1]])
    # By brute force: a dense walk along the polyline, and its point at each wanted length.
    dense = np.concatenate(
        [
            a + (b - a) * np.linspace(0, 1, 400)[:, None]
            for a, b in zip(path[:-1], path[1:], strict=True)
        ]
    )
    along = np.concatenate(
        [[0.0], np.cumsum((np.abs(np.diff(dense, axis=0)) / PANDA.velocity_limit).max(axis=1))]
    )
    wanted = np.linspace(0.0, 1.0, 33) * along[-1]
    for joint in range(7):
        expected = np.interp(wanted, along, dense[:, joint])
        # A joint may stand still along the longest step of another, so compare by position alone.
        np.testing.assert_allclose(points[:, joint], expected, atol=2e-3)


def test_uniform_of_a_path_without_length_stands_still():
    still = np.tile(PANDA.home.astype(np.float32), (5, 1))
    points, whole = _uniform(jnp.asarray(still), 16)
    assert whole == 0.0
    np.testing.assert_array_equal(points, np.tile(still[0], (16, 1)))


@pytest.mark.parametrize("waypoints", [3, 4, 64])
def test_natural_slopes_are_scipys(waypoints):
    path = walk(5, waypoints)
    expected = CubicSpline(np.arange(waypoints), path, bc_type="natural")(np.arange(waypoints), 1)
    np.testing.assert_allclose(natural_slopes(waypoints) @ path, expected, atol=1e-5)


def test_trajectories_keep_velocity_acceleration_and_jerk_limits():
    paths = np.stack([walk(seed, stretch=stretch) for seed in range(8) for stretch in (0.1, 1.0)])
    found = _retime(jnp.asarray(paths))
    for path, q, duration in zip(paths, *map(np.asarray, (found.q, found.duration)), strict=True):
        step = duration / (COUNT - 1)
        np.testing.assert_array_equal(q[[0, -1]], path[[0, -1]])
        # At rest before and after.
        q = np.concatenate([np.repeat(q[:1], 3, axis=0), q, np.repeat(q[-1:], 3, axis=0)]).astype(
            float
        )
        shares = [
            (np.abs(np.diff(q, n=order, axis=0)) / step**order / limit).max()
            for order, limit in (
                (1, PANDA.velocity_limit),
                (2, PANDA.acceleration_limit),
                (3, PANDA.jerk_limit),
            )
        ]
        assert max(shares) <= 1.0
        # And no slower than need be: something is at its limit.
        assert max(shares) > 0.9
        assert length(path) < duration


def test_a_long_straight_motion_takes_little_more_than_its_cruise():
    path = PANDA.home + np.linspace(0.0, 1.0, 64)[:, None] * [2.0, 0, 0, 0, 0, 0, 0]
    duration = float(_retime(jnp.asarray(path, jnp.float32)[None]).duration[0])
    # Bang-bang: cruise time, and half of each ramp's time lost.
    best = 2.0 / PANDA.velocity_limit[0] + PANDA.velocity_limit[0] / PANDA.acceleration_limit[0]
    assert best < duration < 1.1 * best


def test_samples_lie_on_the_path_in_its_order():
    path = walk(11)
    q = np.asarray(_retime(jnp.asarray(path)[None]).q[0])
    curve = CubicSpline(np.arange(64), path, bc_type="natural")(np.linspace(0, 63, 20_000))
    nearest = np.array([np.linalg.norm(curve - sample, axis=1).argmin() for sample in q])
    off = np.linalg.norm(curve[nearest] - q, axis=1)
    assert off.max() < 1e-3
    assert np.all(np.diff(nearest) >= -2)


def test_a_path_without_length_takes_no_time_worth_mention():
    found = _retime(jnp.tile(jnp.asarray(PANDA.home, jnp.float32), (1, 64, 1)))
    assert np.all(np.isfinite(found.q)) and 0.0 <= float(found.duration[0]) < 0.1
