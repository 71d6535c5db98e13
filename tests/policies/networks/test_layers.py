"""The layers with gradients of their own are what `jnp` computes, and so are the gradients."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from drpbench.policies.networks.layers import attention, dot_general, greatest, matmul


def softmax_attention(q, k, v):
    logits = jnp.einsum("...qd,...kd->...qk", q, k) / np.sqrt(q.shape[-1])
    return jnp.einsum("...qk,...kd->...qd", jax.nn.softmax(logits, axis=-1), v)


CASES = {
    "matmul": (matmul, jnp.matmul, [(2, 5, 3), (3, 4)]),
    "matmul of a row": (matmul, jnp.matmul, [(3,), (3, 4)]),
    "greatest": (greatest, lambda x: jnp.max(x, axis=-2), [(2, 3, 7, 4)]),
    "attention": (attention, softmax_attention, [(2, 3, 5, 8), (2, 3, 7, 8), (2, 3, 7, 8)]),
    "attention to itself": (attention, softmax_attention, [(6, 4)] * 3),
}


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("size", [1.0, 30.0])
def test_values_and_gradients(case, size):
    ours, plain, shapes = CASES[case]
    keys = jax.random.split(jax.random.key(0), len(shapes) + 1)
    inputs = [size * jax.random.normal(k, s) for k, s in zip(keys, shapes, strict=False)]
    expected, pull_plain = jax.vjp(plain, *inputs)
    found, pull = jax.vjp(jax.jit(ours), *inputs)
    np.testing.assert_allclose(found, expected, rtol=2e-5, atol=2e-5 * size)
    upstream = jax.random.normal(keys[-1], expected.shape)
    for a, b in zip(pull(upstream), pull_plain(upstream), strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-3, atol=1e-4 * size)


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES)
def test_batching_changes_nothing(case):
    ours, _, shapes = CASES[case]
    keys = jax.random.split(jax.random.key(1), len(shapes))
    inputs = [jax.random.normal(k, (3, *s)) for k, s in zip(keys, shapes, strict=True)]

    def loss(*inputs):
        return jnp.sum(jnp.sin(ours(*inputs)))

    batched = jax.jit(jax.vmap(jax.grad(loss)))(*inputs)
    for i in range(3):
        single = jax.grad(loss)(*(x[i] for x in inputs))
        np.testing.assert_allclose(batched[i], single, atol=1e-5)


def test_equal_maxima_share_the_gradient():
    x = jnp.asarray([[1.0, 5.0], [2.0, 5.0], [2.0, 0.0], [2.0, 5.0]])
    gradient = jax.grad(lambda x: greatest(x) @ jnp.asarray([3.0, 6.0]))(x)
    np.testing.assert_allclose(gradient, [[0, 2], [1, 2], [1, 0], [1, 2]])


def test_logits_of_any_size_do_not_overflow():
    q = jnp.full((4, 8), 1e4)
    v = jnp.arange(32.0).reshape(4, 8)
    np.testing.assert_allclose(attention(q, q, v), jnp.tile(v.mean(axis=0), (4, 1)), rtol=1e-5)


def test_it_is_the_product_that_flax_asks_for():
    x, kernel = jnp.ones((2, 3, 4)), jnp.arange(20.0).reshape(4, 5)
    asked = (((2,), (0,)), ((), ()))
    np.testing.assert_array_equal(
        dot_general(x, kernel, asked, precision=None), jax.lax.dot_general(x, kernel, asked)
    )
