"""Policies from outside: by import path (`my_package.my_module:MyPolicy`) or by entry point."""

import importlib
import importlib.metadata
import inspect
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import PRNGKeyArray

from drpbench.contract import Observation, Policy, Spec
from drpbench.geometry import Primitives

from .errors import PolicyError, told

GROUP = "drpbench.policies"
"""The entry-point group that an installed package offers its policies under."""


def installed(group: str = GROUP) -> dict[str, importlib.metadata.EntryPoint]:
    """What installed packages offer in an entry-point group, by name. Nothing is imported."""
    return {entry.name: entry for entry in importlib.metadata.entry_points(group=group)}


def find(
    path: str, meant: str = "a class, or a function that makes a policy"
) -> Callable[..., Any]:
    """What stands at an import path: `meant` in words, such as a class.

    The current directory is importable. Raises PolicyError.
    """
    module_name, _, name = path.partition(":")
    here = str(Path.cwd())
    if here not in sys.path:
        sys.path.insert(0, here)
    module = _module(path, module_name)
    found: Any = module
    for part in name.split("."):
        found = getattr(found, part, None)
    if callable(found) and name:
        return found
    if found is not None and name:
        raise PolicyError(f"{path}: expected {meant}, got {name} of type {type(found).__name__}")
    offered = [
        key
        for key, value in vars(module).items()
        if inspect.isclass(value) and value.__module__ == module.__name__
    ]
    raise PolicyError(
        f"{path}: {module_name} has no {name!r}; its classes: {', '.join(offered) or 'none'}"
    )


def offered(entry: importlib.metadata.EntryPoint) -> Callable[..., Any]:
    """What an entry point leads to. Raises PolicyError."""
    try:
        return entry.load()
    except (Exception, SystemExit) as error:
        raise PolicyError(
            f"{entry.name} ({entry.value}): importing it failed: {told(error)}"
        ) from None


def _module(path: str, name: str) -> ModuleType:
    if not all(part.isidentifier() for part in name.split(".")):
        raise PolicyError(
            f"{path}: expected package.module:ClassName, got {name!r} as the module's name"
            " (dots, and no .py at the end)"
        )
    try:
        return importlib.import_module(name)
    except ModuleNotFoundError as error:
        if error.name and (name == error.name or name.startswith(f"{error.name}.")):
            hint = "; without .py, it is a module's name" if name.endswith(".py") else ""
            raise PolicyError(
                f"{path}: there is no module {error.name!r}, neither here ({Path.cwd()}) nor "
                f"installed"
                f"{hint}"
            ) from None
        raise PolicyError(f"{path}: importing it failed: {told(error)}") from None
    except (Exception, SystemExit) as error:
        raise PolicyError(f"{path}: importing it failed: {told(error)}") from None


def built(name: str, make: Callable[..., Any], arguments: dict[str, Any]) -> Any:
    """The policy that `make` makes. Raises PolicyError."""
    try:
        return make(**arguments)
    except PolicyError:
        raise
    except (Exception, SystemExit) as error:
        raise PolicyError(f"{name}: making it failed: {told(error)}") from None


def is_host(policy: Any) -> bool:
    """Whether a policy is stepped outside jit: it has `reset` where a JAX policy has `init`."""
    return not hasattr(policy, "init") and hasattr(policy, "reset")


def check(name: str, policy: Any, spec: Spec) -> None:
    """Raises PolicyError unless `policy` is one: a host policy, or a JAX policy that can be traced.

    `spec` is of the observations that it will see.
    """
    wanted = ("reset", "act") if is_host(policy) else ("init", "act")
    if not any(callable(getattr(policy, method, None)) for method in ("reset", "init", "act")):
        raise PolicyError(
            f"{name} is no policy: it has neither reset and act (a host policy), nor init and act"
            " (a JAX policy)"
        )
    for method in wanted:
        if not callable(getattr(policy, method, None)):
            either = "reset(observation), or init(observation) in JAX"
            missing = f"{method}(observation)" if method == "act" else either
            raise PolicyError(f"{name} is no policy: it has no method {missing}")
    if not isinstance(getattr(policy, "privileged", False), bool):
        raise PolicyError(f"{name}: privileged must be True or False")
    if not is_host(policy):
        _check_traceable(name, policy, spec)


def _check_traceable(name: str, policy: Any, spec: Spec) -> None:
    """Runs `init` and `act` on shapes alone, so that a mistake costs no compilation."""
    if not isinstance(policy, Policy):
        raise PolicyError(
            f"{name} is no JAX policy: it has no attribute privileged (True or False)"
        )
    if any(leaf is policy for leaf in jax.tree.leaves(policy)):
        raise PolicyError(
            f"{name} is no JAX pytree: make it a frozen dataclass under"
            " @jax.tree_util.register_dataclass"
        )
    method: str = "init"
    found: dict[str, Any] = {}

    def traced(key: PRNGKeyArray) -> None:
        nonlocal method
        seen = nothing_seen(spec, policy.privileged)
        carry = policy.init(seen)
        method = "act"
        found["target"], after = policy.act(seen, carry, key)
        found["forms"] = _form(carry), _form(after)

    try:
        jax.eval_shape(traced, jax.random.key(0))
    except Exception as error:
        raise PolicyError(f"{name}: {method} failed: {told(error)}") from None
    shape = getattr(found["target"], "shape", type(found["target"]).__name__)
    if shape != (wanted := spec["joint_position"].shape):
        raise PolicyError(f"{name}: act answers targets of shape {shape}, not {wanted}")
    before, after = found["forms"]
    if before != after:
        raise PolicyError(
            f"{name}: act answers a carry of another form than init's: keep shapes and types"
        )


def _form(carry: Any) -> tuple:
    leaves, structure = jax.tree.flatten(carry)
    return structure, [(jnp.shape(leaf), jnp.result_type(leaf)) for leaf in leaves]


def nothing_seen(spec: Spec, privileged: bool = False) -> Observation:
    """An observation with zeros in every array of the spec, and one obstacle that is not there."""
    obstacles = Primitives(
        kind=jnp.zeros(1, jnp.int32),
        half_size=jnp.ones((1, 3)),
        position=jnp.zeros((1, 3)),
        rotation=jnp.eye(3)[None],
        mask=jnp.zeros(1, bool),
    )
    arrays = {name: jnp.zeros(of.shape, of.dtype) for name, of in spec.items()}
    return Observation(**arrays, obstacles=obstacles if privileged else None)
