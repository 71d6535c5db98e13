"""Parametrisations of a joint-space path: uniform in length, and in time under the arm's limits."""

from dataclasses import dataclass
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from drpbench.robot import PANDA, Robot

from . import polyline
from .spline import natural_slopes

_GRID = 512  # intervals of the path on which its speed is planned
_BEND_SHARE = (
    0.7  # of the acceleration limit that bends may take, so that some is left for the speed
)
_TINY = 1.0e-6


def step_lengths(path: Float[Array, "T J"], robot: Robot = PANDA) -> Float[Array, " T-1"]:
    """Length [s] of each step of a polyline: max_i |dq_i| / velocity_limit_i, its least
    duration."""
    return jnp.max(
        jnp.abs(jnp.diff(path, axis=0)) / robot.velocity_limit.astype(np.float32), axis=1
    )


def uniform(
    path: Float[Array, "T J"], count: int, robot: Robot = PANDA
) -> tuple[Float[Array, "{count} J"], Float[Array, ""]]:
    """The polyline `path` at `count` points of equal steps in length, and its whole length [s].

    The length of a step is `step_lengths`, so the length of a path is the least time in which the
    velocity limits let the arm follow it. First and last points are kept exactly; a path of no
    length gives `count` times its first point.
    """
    points, whole = polyline.evenly(path, step_lengths(path, robot), count)
    return points.at[0].set(path[0]).at[-1].set(path[-1]), whole


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Trajectory:
    """Joint positions [rad] at N equal steps of time, from rest to rest in `duration` [s]."""

    q: Float[Array, "*batch N J"] | Float[np.ndarray, "*batch N J"]
    duration: Float[Array, "*batch"] | Float[np.ndarray, "*batch"]


def retime(path: Float[Array, "T J"], count: int = 256, robot: Robot = PANDA) -> Trajectory:
    """`path` (T waypoints, T at least 3) in time, within the velocity, acceleration and jerk
    limits.

    The path is the natural cubic spline q(s) through the waypoints. With x = (ds/dt)^2 and u =
    d2s/dt2

        |q'| sqrt(x) <= velocity limit      |q'| u + |q''| x <= acceleration limit

    for every joint; the speed is the largest that a pass forwards and one backwards leave (Bobrow
    et al., 1985; not the optimum, for the second inequality is stricter than need be). The whole is
    then slowed down by as much as velocity, acceleration and jerk of the samples demand, by their
    finite differences.
    """
    slopes = jnp.einsum("ij,ja->ia", natural_slopes(len(path)), path, precision="highest")
    step = (len(path) - 1) / _GRID
    s = jnp.arange(_GRID + 1, dtype=path.dtype) * step
    _, first, second = jax.vmap(partial(_spline, path, slopes))(s)
    first, second = jnp.maximum(jnp.abs(first), _TINY), jnp.maximum(jnp.abs(second), _TINY)
    fastest, strongest = (
        jnp.asarray(limit, path.dtype) for limit in (robot.velocity_limit, robot.acceleration_limit)
    )
    ceiling = jnp.min(jnp.minimum((fastest / first) ** 2, _BEND_SHARE * strongest / second), axis=1)

    def faster(x, at):
        first, second, ceiling = at
        push = jnp.min((strongest - second * x) / first)
        x = jnp.minimum(x + 2.0 * step * push, ceiling)
        return x, x

    def reach(first, second, ceiling):
        _, x = jax.lax.scan(faster, jnp.zeros(()), (first[:-1], second[:-1], ceiling[1:]))
        return jnp.concatenate([jnp.zeros(1), x])

    x = reach(first, second, ceiling)
    x = reach(first[::-1], second[::-1], x[::-1])[::-1]
    speed = jnp.sqrt(x)
    # Between two points of the grid d2s/dt2 is constant.
    times = 2.0 * step / (speed[:-1] + speed[1:])
    ends = polyline.ends(times)
    wanted = jnp.linspace(0.0, 1.0, count) * ends[-1]
    at = jnp.sum(wanted[:, None] >= ends[None, 1:-1], axis=1)
    since = wanted - ends[at]
    push = (x[at + 1] - x[at]) / (2.0 * step)
    place = s[at] + jnp.clip(since * (speed[at] + 0.5 * push * since), 0.0, step)
    q = jax.vmap(lambda s: _spline(path, slopes, s)[0])(place)
    q = q.at[0].set(path[0]).at[-1].set(path[-1])
    return Trajectory(q, ends[-1] * _slowing(q, ends[-1] / (count - 1), robot))


def _slowing(q: Float[Array, "N J"], step: Float[Array, ""], robot: Robot) -> Float[Array, ""]:
    """By which factor samples `step` [s] apart must be slowed down, starting and ending at rest."""
    q = jnp.concatenate([jnp.repeat(q[:1], 3, axis=0), q, jnp.repeat(q[-1:], 3, axis=0)])
    needed = jnp.ones(())
    for order, limit in (
        (1, robot.velocity_limit),
        (2, robot.acceleration_limit),
        (3, robot.jerk_limit),
    ):
        difference = jnp.max(jnp.abs(jnp.diff(q, n=order, axis=0)) / limit.astype(np.float32))
        needed = jnp.maximum(needed, (difference / step**order) ** (1.0 / order))
    return 1.001 * needed


def _spline(path, slopes, s):
    """q, q' and q'' of the cubic spline with these slopes at the waypoints 0, 1, 2, ..."""
    i = jnp.clip(s.astype(jnp.int32), 0, len(path) - 2)
    t, rise = s - i, path[i + 1] - path[i]
    # Hermite's form, with the slopes' excess over the chord.
    a, b = slopes[i] - rise, slopes[i + 1] - rise
    q = path[i] + t * rise + t * (1 - t) * ((1 - t) * a - t * b)
    first = rise + (1 - 4 * t + 3 * t * t) * a + (3 * t * t - 2 * t) * b
    second = (6 * t - 4) * a + (6 * t - 2) * b
    return q, first, second
