"""A Flax module of some size as pure functions of its parameters."""

import functools
from collections.abc import Callable
from typing import Any

import jax.numpy as jnp
from flax import nnx

from drpbench.robot import PANDA, Robot

Parameters = dict[str, Any]
"""A nested dict of float32 arrays."""
Make = Callable[..., Any]
"""A class of modules, made of size, rngs, dtype and robot."""


def initial(make: Make, size: Any, seed: int = 0, robot: Robot = PANDA) -> Parameters:
    """The parameters of an untrained network."""
    return nnx.to_pure_dict(nnx.state(make(size, nnx.Rngs(seed), robot=robot), nnx.Param))


@functools.cache
def _form(make: Make, size: Any, dtype: str, robot: Robot) -> tuple[Any, Any]:
    """The network without its numbers."""
    network = nnx.eval_shape(lambda: make(size, nnx.Rngs(0), jnp.dtype(dtype), robot))
    return nnx.split(network, nnx.Param)


def shapes(make: Make, size: Any, robot: Robot = PANDA) -> dict[str, Any]:
    """The tree of the parameters, with a shape and type in place of each array."""
    return nnx.to_pure_dict(_form(make, size, "float32", robot)[1])


def network(
    make: Make,
    size: Any,
    parameters: Parameters,
    dtype: str = "float32",
    robot: Robot = PANDA,
) -> Any:
    """The module of this size with these parameters."""
    form, state = _form(make, size, dtype, robot)
    nnx.replace_by_pure_dict(state, parameters)
    return nnx.merge(form, state)
