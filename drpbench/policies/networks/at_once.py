"""A network that takes a batch whole where it is vmapped."""

from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array


def at_once(network: Callable[..., Any]) -> Callable[..., Any]:
    """`network(parameters, *seen)`, given a whole batch at once where it is vmapped over what is
    seen: it then knows the batch's size, and takes it in pieces that fit the cache."""

    @jax.custom_batching.custom_vmap
    def whole(parameters: Any, *seen: Array) -> Any:
        return network(parameters, *seen)

    @whole.def_vmap
    def _(count: int, batched: Sequence, parameters: Any, *seen: Array) -> tuple[Any, Any]:
        of_parameters, *of_seen = batched
        if any(jax.tree.leaves(of_parameters)):
            axes = jax.tree.map(lambda is_batched: 0 if is_batched else None, batched)
            found = jax.vmap(network, axes)(parameters, *seen)
        else:
            seen = tuple(
                x if is_batched else jnp.broadcast_to(x, (count, *x.shape))
                for x, is_batched in zip(seen, of_seen, strict=True)
            )
            found = network(parameters, *seen)
        return found, jax.tree.map(lambda _: True, found)

    return whole
