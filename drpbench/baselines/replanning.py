"""Plans are made now and then, and cost nothing in between."""

from collections.abc import Callable, Sequence
from typing import TypeVar

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool

from drpbench.contract import Observation

Carry = TypeVar("Carry")


def planned_where(
    wanted: Bool[Array, ""],
    new: Callable[[Observation, Carry], Carry],
    observation: Observation,
    old: Carry,
) -> Carry:
    """`new(observation, old)` where it is wanted, else `old`; of a batch nothing is computed unless
    some lane wants it."""
    # As leaves: what says which of them are batched is no observation, nor a plan.
    seen, seen_form = jax.tree.flatten(observation)
    before, form = jax.tree.flatten(old)
    count_seen = len(seen)

    def again(leaves: Sequence[Array]) -> tuple[Array, ...]:
        seen, before = leaves[:count_seen], leaves[count_seen:]
        found = new(jax.tree.unflatten(seen_form, seen), jax.tree.unflatten(form, before))
        return tuple(jax.tree.leaves(found))

    @jax.custom_batching.custom_vmap
    def chosen(wanted: Array, *leaves: Array) -> tuple[Array, ...]:
        kept = tuple(leaves[count_seen:])
        return jax.lax.cond(wanted, again, lambda _: kept, leaves)

    @chosen.def_vmap
    def _(
        count: int, batched: Sequence, wanted: Array, *leaves: Array
    ) -> tuple[tuple[Array, ...], tuple[bool, ...]]:
        wanted, *whole = (
            leaf if is_batched else jnp.broadcast_to(leaf, (count, *jnp.shape(leaf)))
            for leaf, is_batched in zip((wanted, *leaves), batched, strict=True)
        )
        kept = tuple(whole[count_seen:])

        def some(leaves: Sequence[Array]) -> tuple[Array, ...]:
            pairs = zip(jax.vmap(again)(leaves), kept, strict=True)
            lanes = (wanted.reshape(-1, *[1] * (a.ndim - 1)) for a in kept)
            return tuple(jnp.where(lane, a, b) for lane, (a, b) in zip(lanes, pairs, strict=True))

        found = jax.lax.cond(jnp.any(wanted), some, lambda _: kept, whole)
        return found, (True,) * len(kept)

    return jax.tree.unflatten(form, chosen(wanted, *seen, *before))
