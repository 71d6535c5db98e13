"""One place that decides how XLA compiles the world.

jax 0.7 to 0.10 on the CPU: the backend's fusion emitters recompute a kinematic chain once for every
use of it, which makes `mjx.kinematics` about 1000 times slower. Turning them off per function cures
it. From jax 0.11 on the cure is not needed, and the unknown option would be an error.
"""

import os
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from functools import cached_property, update_wrapper
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from drpbench.errors import DrpbenchError


def jit(function: Callable, **options: Any) -> Callable:
    """`jax.jit` with the compiler options that this jax version and backend need.

    It must be the outermost `jit`: XLA takes compiler options only there. The backend is asked for
    at the first call, so that a module that is imported starts none.
    """
    return _Jitted(function, options)


class _Jitted:
    def __init__(self, function: Callable, options: dict[str, Any]):
        self._function, self._options = function, options
        update_wrapper(self, function)

    @cached_property
    def _compiled(self) -> Any:
        version = tuple(int(part) for part in jax.__version__.split(".")[:2])
        options = self._options
        if jax.default_backend() == "cpu" and (0, 7) <= version < (0, 11):
            options = options | {"compiler_options": {"xla_cpu_use_fusion_emitters": False}}
        return jax.jit(self._function, **options)

    def __call__(self, *args: Any, **kwargs: Any) -> Any:
        with pinned():
            return self._compiled(*args, **kwargs)

    def __getattr__(self, name: str) -> Any:
        """`lower`, `trace` and what else a jitted function has."""
        if name.startswith("__"):
            raise AttributeError(name)
        return getattr(self._compiled, name)


@contextmanager
def pinned() -> Iterator[None]:
    """What JAX's configuration can change of a number, as drpbench means it: random streams,
    precision, promotion of types and shapes. For this thread; also a decorator.

    A user's environment (`JAX_ENABLE_X64=1`, `JAX_DEFAULT_PRNG_IMPL=rbg`) or a policy's module may
    set it otherwise for their own code.
    """
    with ExitStack() as stack:
        for setting in (
            jax.enable_x64(False),
            jax.default_prng_impl("threefry2x32"),
            jax.threefry_partitionable(True),
            jax.default_matmul_precision(None),
            jax.numpy_dtype_promotion("standard"),
            jax.numpy_rank_promotion("allow"),
            jax.debug_nans(False),
            jax.debug_infs(False),
        ):
            stack.enter_context(setting)
        yield


def require_backend() -> None:
    """Raises DrpbenchError, one line, where JAX has no backend to compute on."""
    try:
        jax.devices()
    except Exception as error:  # an AssertionError without a word, a RuntimeError with many
        asked = os.environ.get("JAX_PLATFORMS", "")
        told = " ".join(str(error).split())[:200]
        where = f"JAX_PLATFORMS={asked}: " if asked else ""
        raise DrpbenchError(
            f"{where}expected a device that JAX can compute on, got none"
            + (f" ({told})" if told else "")
            + ("; unset JAX_PLATFORMS or set it to cpu" if asked else "")
        ) from None


def short_loops_unrolled() -> bool:
    """Whether to unroll a `scan` of a few small steps.

    Not on the CPU: a loop's results are computed once, an unrolled chain again for each use of each
    number in it (1.6 against 0.3 µs for forward kinematics, 6 against 0.9 with points on the
    links).
    """
    return jax.default_backend() != "cpu"


# XLA folds away a minimum with the largest number there is, and the loop with it.
_LARGE_FLOAT, _LARGE_INT = 1.0e30, 2**31 - 2


def stored(
    array: Float[Array, "*shape"] | Int[Array, "*shape"],
) -> Float[Array, "*shape"] | Int[Array, "*shape"]:
    """The same values, computed once: what a loop returns is not fused into what uses it.

    XLA on the CPU otherwise repeats an unrolled search, scalar by scalar, inside every reduction of
    its result: 26 µs instead of 4 for the distance of 155 spheres to 27 primitives. Numbers must be
    below 1e30, integers below 2^31 - 1.
    """
    large = _LARGE_FLOAT if jnp.issubdtype(array.dtype, jnp.floating) else _LARGE_INT
    return jax.lax.fori_loop(0, 2, lambda _, value: jnp.minimum(value, large), array)


def use_cache() -> None:
    """Keeps compiled programs between runs, in the user's cache folder (`DRPBENCH_CACHE` names
    another, `off` none). Raises DrpbenchError where there is nothing to compile for."""
    require_backend()
    named = os.environ.get("DRPBENCH_CACHE", "")
    if named.lower() == "off":
        return
    home = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    folder = Path(named) if named else home / "drpbench" / "xla"
    jax.config.update("jax_compilation_cache_dir", str(folder))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 1.0)
