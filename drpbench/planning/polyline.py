"""Points along a polyline of T waypoints, whatever the length of its T - 1 steps is measured in.

The last two functions are for the host, in double precision: they decide numbered problems and
certificates, so their results do not depend on a compiler.
"""

from collections.abc import Sequence

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float


def ends(steps: Float[Array, " S"]) -> Float[Array, " S+1"]:
    """Lengths of a polyline up to each of its waypoints, from the lengths of its steps."""
    return jnp.concatenate([jnp.zeros(1), jnp.cumsum(steps)])


def along(
    path: Float[Array, "T J"], ends: Float[Array, " T"], wanted: Float[Array, " N"]
) -> Float[Array, "N J"]:
    """Points of a polyline at the lengths `wanted`, `ends` being the lengths up to its
    waypoints."""
    # Comparing with all of them is faster than a search, paths being short.
    step = jnp.sum(wanted[:, None] >= ends[None, 1:-1], axis=1)
    low, high = ends[step], ends[step + 1]
    share = jnp.where(high > low, (wanted - low) / jnp.where(high > low, high - low, 1.0), 0.0)
    return path[step] + jnp.clip(share, 0.0, 1.0)[:, None] * (path[step + 1] - path[step])


def between(path: Float[Array, "T J"], at: Float[Array, " N"]) -> Float[Array, "N J"]:
    """Points of a polyline at fractional numbers of its waypoints, from 0 to T - 1.

    As `along`, were every step of length 1, but for the rounding.
    """
    low = jnp.minimum(at.astype(jnp.int32), len(path) - 2)
    return path[low] + (at - low)[:, None] * (path[low + 1] - path[low])


def evenly(
    path: Float[Array, "T J"], steps: Float[Array, " T-1"], count: int
) -> tuple[Float[Array, "{count} J"], Float[Array, ""]]:
    """`count` points at equal distances along a polyline, and its whole length."""
    up_to = ends(steps)
    return along(path, up_to, jnp.linspace(0.0, 1.0, count) * up_to[-1]), up_to[-1]


def evenly_on_host(
    path: Float[np.ndarray, "T J"], steps: Float[np.ndarray, " T-1"], count: int
) -> Float[np.ndarray, "{count} J"]:
    """As `evenly`, without the length, in double precision."""
    up_to = np.concatenate([[0.0], np.cumsum(steps)])
    at = np.linspace(0.0, up_to[-1], count)
    return np.stack([np.interp(at, up_to, joint) for joint in path.T], axis=1)


def divided(path: Float[np.ndarray, "T J"], parts: Sequence[int]) -> Float[np.ndarray, "N J"]:
    """The waypoints, and between them each step cut into as many equal `parts` as its number
    says."""
    pieces = [path[:1]]
    for a, b, count in zip(path[:-1], path[1:], parts, strict=True):
        pieces.append(a + (b - a) * (np.arange(1, count + 1) / count)[:, None])
    return np.concatenate(pieces)
