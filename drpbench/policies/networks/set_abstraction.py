"""PointNet++'s set abstraction: a cloud becomes a few tokens, each of which sees a ball of points.

Farthest-point sampling picks the centres, a ball query groups the points around each, a small
network shared by all points looks at them relative to their centre, and a maximum over the group
makes a token (Qi et al., PointNet++, 2017). The neighbourhoods are exactly those of the paper's
code: the first `samples` points in index order that are nearer than the radius, padded with the
first of them.

Tokens of relative coordinates know nothing of where they are: the caller adds the centre's
position.
"""

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from drpbench.compile import stored

_BITS = 32
_PIECE = 8192  # neighbours at a time


def farthest_points(
    points: Float[Array, "*batch N 3"], mask: Bool[Array, "*batch N"], count: int
) -> Int[Array, "*batch {count}"]:
    """Indices of `count` points, each the farthest from those before it; the first valid one
    begins.

    Ties go to the smaller index. Masked points are never chosen while there is a valid one; with
    fewer distinct points than `count`, the first is repeated; a cloud without points gives index 0.
    """
    x, y, z = (points[..., i] for i in range(3))
    order = jnp.broadcast_to(jnp.arange(points.shape[-2], dtype=jnp.int32), mask.shape)

    def pick(step: Array, state: tuple[Array, Array]) -> tuple[Array, Array]:
        gap, chosen = state
        # The largest first, then the first that has it: XLA's argmax on the CPU is far slower.
        best = jnp.max(gap, axis=-1, keepdims=True)
        index = jnp.min(jnp.where(gap == best, order, order.shape[-1] - 1), axis=-1, keepdims=True)
        away = sum(jnp.square(c - jnp.take_along_axis(c, index, axis=-1)) for c in (x, y, z))
        chosen = jax.lax.dynamic_update_index_in_dim(chosen, index[..., 0], step, 0)
        return jnp.where(mask, jnp.minimum(gap, away), -1.0), chosen

    gap = jnp.where(mask, jnp.inf, -1.0).astype(points.dtype)
    chosen = jnp.zeros((count, *mask.shape[:-1]), jnp.int32)
    _, chosen = jax.lax.fori_loop(0, count, pick, (gap, chosen))
    return jnp.moveaxis(chosen, 0, -1)


def ball_query(
    points: Float[Array, "*batch N 3"],
    mask: Bool[Array, "*batch N"],
    centers: Float[Array, "*batch K 3"],
    radius: float,
    samples: int,
) -> Int[Array, "*batch K {samples}"]:
    """For each centre, the first `samples` points in index order that are nearer than `radius` [m].

    Padded with the first one found, and with index 0 where there is none. Neither sorts nor counts
    along the cloud: who is near is kept as bits, 32 points a word, and the n-th set bit is found by
    bisection.
    """
    words = -(-points.shape[-2] // _BITS)
    padding = [(0, 0)] * (mask.ndim - 1) + [(0, words * _BITS - mask.shape[-1])]
    seen = jnp.pad(mask, padding).reshape(*mask.shape[:-1], 1, words, _BITS)
    away: Array | float = 0.0
    for i in range(3):
        component = jnp.pad(points[..., i], padding).reshape(seen.shape)
        away = away + jnp.square(component - centers[..., i, None, None])
    near = seen & (away < radius**2)
    bit = jnp.left_shift(jnp.uint32(1), jnp.arange(_BITS, dtype=jnp.uint32))
    word = jnp.sum(jnp.where(near, bit, jnp.uint32(0)), axis=-1, dtype=jnp.uint32)

    # before[w]: how many are near in the words before w.
    size = jax.lax.population_count(word).astype(jnp.int32)
    before = jnp.cumsum(size, axis=-1) - size
    found = jnp.sum(size, axis=-1)
    rank = jnp.arange(samples, dtype=jnp.int32)
    rank = jnp.where(rank < found[..., None], rank, 0)
    # The word that holds the one with this rank: the last with no more than `rank` before it.
    which = jnp.sum(before[..., None, :] <= rank[..., None], axis=-1) - 1
    bits = jnp.take_along_axis(word, which, axis=-1)
    left = rank - jnp.take_along_axis(before, which, axis=-1)
    place = jnp.zeros_like(left)
    for half in (16, 8, 4, 2, 1):
        low = bits & jnp.uint32((1 << half) - 1)
        count = jax.lax.population_count(low).astype(jnp.int32)
        above = left >= count
        bits = jnp.where(above, bits >> half, low)
        left = jnp.where(above, left - count, left)
        place = jnp.where(above, place + half, place)
    return jnp.where(found[..., None] > 0, which * _BITS + place, 0)


def gather(points: Float[Array, "*batch N C"], index: Int[Array, "..."]) -> Float[Array, "... C"]:
    """The points of the given indices: (*batch, *groups) gives (*batch, *groups, C)."""
    batch, groups = index.shape[: points.ndim - 2], index.shape[points.ndim - 2 :]
    flat = jnp.take_along_axis(points, index.reshape(*batch, -1, 1), axis=-2)
    return flat.reshape(*batch, *groups, points.shape[-1])


def neighbourhoods(
    points: Float[Array, "*batch N 3"],
    mask: Bool[Array, "*batch N"],
    centers: Float[Array, "*batch K 3"],
    radius: float,
    samples: int,
    features: Float[Array, "*batch N F"] | None = None,
) -> Float[Array, "*batch K {samples} C"]:
    """Each centre's neighbours relative to it, in radii: within [-1, 1]; then their features, if
    any.

    Finite for a cloud without points too, if its centres are its index 0.
    """
    index = ball_query(points, mask, centers, radius, samples)
    relative = (gather(points, index) - centers[..., None, :]) / radius
    if features is not None:
        relative = jnp.concatenate([relative, gather(features, index)], axis=-1)
    return _apart(relative)


def _apart(x: Float[Array, "..."]) -> Float[Array, "..."]:
    """The same numbers. XLA on the CPU would fuse what makes them into the matrix products that use
    them, and is several times slower for it."""
    return stored(x) if jax.default_backend() == "cpu" else x


def in_pieces(function: Callable, neighbours: int, *clouds: Array) -> Array:
    """`function` of clouds (batch, ...), some clouds at a time on the CPU; `neighbours` counts a
    cloud's.

    What all neighbours of a batch become is far larger than any cache, and XLA on the CPU takes new
    memory for it at each call: a few clouds at a time are up to five times faster. So is computing
    it again for the gradient rather than keeping it. An accelerator takes the batch whole.
    """
    batch = clouds[0].shape[0]
    most = max(1, _PIECE // neighbours)
    size = max(n for n in range(1, min(most, batch) + 1) if batch % n == 0)
    if jax.default_backend() != "cpu" or size == batch:
        return _apart(function(*clouds))
    pieces = [cloud.reshape(batch // size, size, *cloud.shape[1:]) for cloud in clouds]
    found = jax.lax.map(lambda piece: jax.checkpoint(function)(*piece), pieces)
    return found.reshape(batch, *found.shape[2:])


def check_neighbourhoods() -> str | None:
    """Whether this machine finds the right neighbourhoods: the fault in words, or None.

    A wrong build of this very operation has given a published policy's users a success rate of
    zero. The check runs the compiled operations on a small cloud with masked, clustered and
    repeated points, and does the same by counting in numpy.
    """
    rng = np.random.default_rng(0)
    count, tokens, radius, samples = 200, 24, 0.12, 8
    points = rng.uniform(-0.4, 0.4, (count, 3)).astype(np.float32)
    points[50:120] = 0.05 * points[50:120]
    points[120:140] = points[:20]
    mask = rng.random(count) < 0.8
    mask[:3] = False
    compiled = jax.jit(lambda points, mask: farthest_points(points, mask, tokens))
    chosen = np.asarray(compiled(points, mask))
    gap = np.where(mask, np.inf, -1.0)
    for step, index in enumerate(chosen):
        best = int(np.flatnonzero(mask)[0]) if step == 0 else int(np.argmax(gap))
        # Another point is right too if it is as far, but for rounding.
        if not mask[index] or gap[index] < gap[best] - 1e-6 or (step == 0 and index != best):
            return f"farthest-point sampling chose point {index} as number {step}, not point {best}"
        away = np.square(points.astype(float) - points[index]).sum(axis=1)
        gap = np.where(mask, np.minimum(gap, away), -1.0)

    centers = points[chosen]
    compiled = jax.jit(
        lambda points, mask, centers: ball_query(points, mask, centers, radius, samples)
    )
    found = np.asarray(compiled(points, mask, centers))
    for center, row in zip(centers, found, strict=True):
        away = np.square(points.astype(float) - center).sum(axis=1)
        near = np.flatnonzero(mask & (away < radius**2))[:samples]
        expected = [*near, *[near[0]] * (samples - len(near))]
        if row.tolist() != expected:
            return f"the ball query found points {row.tolist()}, not {[int(i) for i in expected]}"
    return None
