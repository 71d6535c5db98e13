"""Parametrisations of a joint-space path: uniform in length, and in time under the arm's limits."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from drpbench.robot import VELOCITY_LIMIT


def step_lengths(path: Float[Array, "T 7"]) -> Float[Array, " T-1"]:
    """Length [s] of each step of a polyline: max_i |dq_i| / VELOCITY_LIMIT_i, its least duration."""
    return jnp.max(jnp.abs(jnp.diff(path, axis=0)) / VELOCITY_LIMIT.astype("float32"), axis=1)


def uniform(
    path: Float[Array, "T 7"], count: int
) -> tuple[Float[Array, "{count} 7"], Float[Array, ""]]:
    """The polyline `path` at `count` points of equal steps in length, and its whole length [s].

    The length of a step is max_i |dq_i| / VELOCITY_LIMIT_i, so the length of a path is the least time
    in which the velocity limits let the arm follow it. First and last points are kept exactly; a path
    of no length gives `count` times its first point.
    """
    ends = jnp.concatenate([jnp.zeros(1), jnp.cumsum(step_lengths(path))])
    wanted = jnp.linspace(0.0, 1.0, count) * ends[-1]
    # Step `i` holds the wanted length: comparing with all is faster than a search, paths being short.
    i = jnp.sum(wanted[:, None] >= ends[None, 1:-1], axis=1)
    low, high = ends[i], ends[i + 1]
    share = jnp.where(high > low, (wanted - low) / jnp.where(high > low, high - low, 1.0), 0.0)
    points = path[i] + jnp.clip(share, 0.0, 1.0)[:, None] * (path[i + 1] - path[i])
    return points.at[0].set(path[0]).at[-1].set(path[-1]), ends[-1]
