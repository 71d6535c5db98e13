"""The world's random numbers: those of JAX, in code that the CPU's compiler takes less time over.

JAX computes a block of random bits over an array of the shape asked for, batch axes included. LLVM
unrolls the short axes of such an array, and a reset draws some twenty of them. Here the same
blocks are computed over flat arrays: the same bits. Only a reset uses them: in a control step they
would change which of the other numbers' products are fused with sums, and so last bits.
"""

import math
from collections.abc import Sequence

import jax
import jax.numpy as jnp
from jax.extend.random import define_prng_impl, threefry2x32_p, threefry_prng_impl
from jaxtyping import Array, PRNGKeyArray, UInt32


@jax.custom_batching.custom_vmap
def _threefry(*words: UInt32[Array, " n"]) -> tuple[UInt32[Array, " n"], UInt32[Array, " n"]]:
    """Threefry-2x32 (Salmon et al. 2011), by elements: two words of the key, two of the counter."""
    first, second = threefry2x32_p.bind(*words)
    return first, second


@_threefry.def_vmap
def _(
    count: int, batched: Sequence[bool], *words: Array
) -> tuple[tuple[Array, ...], tuple[bool, bool]]:
    full = [
        word if has_axis else jnp.broadcast_to(word, (count, *word.shape))
        for word, has_axis in zip(words, batched, strict=True)
    ]
    blocks = _threefry(*(word.reshape(-1) for word in full))
    return tuple(block.reshape(count, -1) for block in blocks), (True, True)


def _blocks(key: Array, shape: tuple[int, ...]) -> tuple[Array, ...]:
    counter = jax.lax.iota(jnp.uint32, math.prod(shape))
    words = (*(jnp.full_like(counter, word) for word in key), jnp.zeros_like(counter), counter)
    return tuple(block.reshape(shape) for block in _threefry(*words))


def _random_bits(key: Array, bit_width: int, shape: tuple[int, ...]) -> Array:
    if bit_width != 32:
        return threefry_prng_impl.random_bits(key, bit_width, shape)
    first, second = _blocks(key, shape)
    return first ^ second


def _split(key: Array, shape: tuple[int, ...]) -> Array:
    return jnp.stack(_blocks(key, shape), axis=-1)


_FLAT = define_prng_impl(
    key_shape=(2,),
    seed=threefry_prng_impl.seed,
    split=_split,
    random_bits=_random_bits,
    fold_in=threefry_prng_impl.fold_in,
    name="threefry2x32_flat",
    tag="ffl",
)


def quickly_compiled(key: PRNGKeyArray) -> PRNGKeyArray:
    """A key from which `jax.random` draws the same numbers as from `key`, a threefry2x32 key."""
    if jax.default_backend() != "cpu":
        return key
    return jax.random.wrap_key_data(jax.random.key_data(key), impl=_FLAT)
