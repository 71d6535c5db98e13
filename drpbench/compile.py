"""One place that decides how XLA compiles the world.

jax 0.7 to 0.10 on the CPU: the backend's fusion emitters recompute a kinematic chain once for every
use of it, which makes `mjx.kinematics` about 1000 times slower. Turning them off per function cures
it. From jax 0.11 on the cure is not needed, and the unknown option would be an error.
"""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float


def jit(function: Callable, **options: Any) -> Callable:
    """`jax.jit` with the compiler options that this jax version and backend need.

    It must be the outermost `jit`: XLA takes compiler options only there.
    """
    version = tuple(int(part) for part in jax.__version__.split(".")[:2])
    if jax.default_backend() == "cpu" and (0, 7) <= version < (0, 11):
        options["compiler_options"] = {"xla_cpu_use_fusion_emitters": False}
    return jax.jit(function, **options)


_HUGE = 1.0e30  # XLA folds a minimum with infinity away, and the loop with it


def stored(array: Float[Array, "*shape"]) -> Float[Array, "*shape"]:
    """The same finite values, computed once: what a loop returns is not fused into what uses it.

    XLA on the CPU otherwise repeats an unrolled search, scalar by scalar, inside every reduction of its
    result: 26 µs instead of 4 for the distance of 155 spheres to 27 primitives.
    """
    return jax.lax.fori_loop(0, 2, lambda _, value: jnp.minimum(value, _HUGE), array)
