"""Matrix products, maximum and attention, with gradients written out.

They are what `jnp` computes, and so are the gradients. XLA on the CPU is slow where autodiff leaves
it to find the order of operations: a product contracted over anything but the last axis of the left
and the first of the right is done in plain loops, and the gradient of a maximum in several passes
over memory. `python benchmarks/impact_inference.py` measures the outcome.
"""

import functools
from typing import Any

import jax
import jax.numpy as jnp
from flax import nnx
from jaxtyping import Array, Float

_Residuals = tuple[Array, ...]


@jax.custom_vjp
def matmul(x: Float[Array, "*rows I"], kernel: Float[Array, "I O"]) -> Float[Array, "*rows O"]:
    """x @ kernel."""
    return x @ kernel


def _matmul_forward(x: Array, kernel: Array) -> tuple[Array, _Residuals]:
    return x @ kernel, (x, kernel)


def _matmul_backward(residuals: _Residuals, g: Array) -> tuple[Array, ...]:
    x, kernel = residuals
    rows, g_rows = x.reshape(-1, x.shape[-1]), g.reshape(-1, g.shape[-1])
    # Autodiff would make the transpose of this.
    over_rows = (((0,), (0,)), ((), ()))
    return g @ kernel.T, jax.lax.dot_general(rows, g_rows, over_rows)


matmul.defvjp(_matmul_forward, _matmul_backward)


def dot_general(
    x: Float[Array, "*rows I"], kernel: Float[Array, "I O"], dimension_numbers: Any, **_: Any
) -> Float[Array, "*rows O"]:
    """`matmul` in the form in which `flax.nnx.Linear` takes it."""
    return matmul(x, kernel)


Linear = functools.partial(
    nnx.Linear, dot_general=dot_general, kernel_init=nnx.initializers.lecun_uniform()
)
"""A linear layer, as all networks here have it."""


@jax.custom_vjp
def greatest(x: Float[Array, "*batch S C"]) -> Float[Array, "*batch C"]:
    """The maximum over the last axis but one. Its gradient is shared evenly by all that attain
    it."""
    return jnp.max(x, axis=-2)


def _greatest_forward(x: Array) -> tuple[Array, _Residuals]:
    most = jnp.max(x, axis=-2)
    return most, (x, most)


def _greatest_backward(residuals: _Residuals, g: Array) -> tuple[Array, ...]:
    x, most = residuals
    attained = x == most[..., None, :]
    each = g / jnp.sum(attained, axis=-2).astype(g.dtype)
    return (jnp.where(attained, each[..., None, :], 0.0),)


greatest.defvjp(_greatest_forward, _greatest_backward)


@jax.custom_vjp
def attention(
    q: Float[Array, "*batch Q D"], k: Float[Array, "*batch T D"], v: Float[Array, "*batch T D"]
) -> Float[Array, "*batch Q D"]:
    """softmax(q k^T / sqrt(D)) v, the softmax in float32."""
    return _attention_forward(q, k, v)[0]


def _transposed(x: Array) -> Array:
    return jnp.swapaxes(x, -1, -2)


def _attention_forward(q: Array, k: Array, v: Array) -> tuple[Array, _Residuals]:
    q = q * q.shape[-1] ** -0.5
    logits = (q @ _transposed(k)).astype(jnp.float32)
    share = jnp.exp(logits - jnp.max(logits, axis=-1, keepdims=True))
    # Divided after the product: by D numbers a row instead of T.
    scale = (1.0 / jnp.sum(share, axis=-1, keepdims=True)).astype(q.dtype)
    share = share.astype(q.dtype)
    y = (share @ v) * scale
    return y, (q, k, v, share, scale, y)


def _attention_backward(residuals: _Residuals, g: Array) -> tuple[Array, ...]:
    # With S = softmax(L): dL = S * (dS - rowsum(S * dS)), and rowsum(S * dS) = rowsum(g * y).
    q, k, v, share, scale, y = residuals
    g_scaled = g * scale
    offset = jnp.sum(g * y, axis=-1, keepdims=True) * scale
    d_logits = share * (g_scaled @ _transposed(v) - offset)
    # Transposed results of plain products, rather than products of transposed matrices.
    dv = _transposed(_transposed(g_scaled) @ share)
    dk = _transposed(_transposed(q) @ d_logits)
    return (d_logits @ k) * q.shape[-1] ** -0.5, dk, dv


attention.defvjp(_attention_forward, _attention_backward)
