"""The paper's loss over a chunk of S rows, in the units of `drpbench.policies.networks.chunks`:

L = 1/S sum_k |chunk_k - answer_k|
"""

from __future__ import annotations

import jax.numpy as jnp
from jaxtyping import Array, Float


def chunk_loss(
    chunk: Float[Array, "*batch C J"], answer: Float[Array, "*batch C J"]
) -> Float[Array, ""]:
    """The mean of L over a batch of chunks that were demonstrated, and of those that were
    answered."""
    squares = jnp.sum(jnp.square(chunk - answer), axis=-1)
    # The root's slope at zero is infinite.
    return jnp.mean(jnp.sqrt(squares + 1e-6))
