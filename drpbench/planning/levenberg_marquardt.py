"""Levenberg and Marquardt's method, for problems that bring their own model of the cost."""

from collections.abc import Callable
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

_FIRST, _LEAST, _MOST = 0.1, 1e-4, 1e4  # damping
_RELAX, _TIGHTEN = 0.3, 5.0  # of the damping after a step that was taken, and one that was not


def minimise(
    evaluate: Callable, propose: Callable, start: Float[Array, "*shape"], iterations: int
) -> Float[Array, "*shape"]:
    """The best point after `iterations` steps from `start`.

    `evaluate(point) -> (cost, gradient, hessian)`, the last two of any kind that `propose(point,
    gradient, hessian, damping) -> point` understands. A step is taken if it lowers the cost.
    """

    def step(_: Array, state: tuple[Any, Any, Array]) -> tuple[Any, Any, Array]:
        tried, best, damping = state
        found = (tried, *evaluate(tried))
        better = found[1] < best[1]
        best = jax.tree.map(partial(jnp.where, better), found, best)
        damping = jnp.where(better, _RELAX * damping, _TIGHTEN * damping)
        damping = jnp.clip(damping, _LEAST, _MOST)
        point, _, gradient, hessian = best
        return propose(point, gradient, hessian, damping), best, damping

    # The start is judged as the first step, so that `evaluate` is compiled once.
    shapes: Any = jax.eval_shape(evaluate, start)
    cost, gradient, hessian = jax.tree.map(lambda leaf: jnp.zeros(leaf.shape, leaf.dtype), shapes)
    first = (start, (start, cost + jnp.inf, gradient, hessian), jnp.float32(_FIRST / _RELAX))
    return jax.lax.fori_loop(0, iterations + 1, step, first)[1][0]
