"""One place that decides how XLA compiles the world.

jax 0.7 to 0.10 on the CPU: the backend's fusion emitters recompute a kinematic chain once for every
use of it, which makes `mjx.kinematics` about 1000 times slower. Turning them off per function cures
it. From jax 0.11 on the cure is not needed, and the unknown option would be an error.
"""

from collections.abc import Callable
from typing import Any

import jax


def jit(function: Callable, **options: Any) -> Callable:
    """`jax.jit` with the compiler options that this jax version and backend need.

    It must be the outermost `jit`: XLA takes compiler options only there.
    """
    version = tuple(int(part) for part in jax.__version__.split(".")[:2])
    if jax.default_backend() == "cpu" and (0, 7) <= version < (0, 11):
        options["compiler_options"] = {"xla_cpu_use_fusion_emitters": False}
    return jax.jit(function, **options)
