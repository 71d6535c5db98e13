"""The world's random numbers: those of JAX, to the bit."""

import jax
import numpy as np
import pytest

from drpbench.envs.random import quickly_compiled

DRAWS = {
    "uniform": lambda key: jax.random.uniform(key, (5, 3), minval=-1.0, maxval=2.0),
    "normal": lambda key: jax.random.normal(key, (4,)),
    "one": jax.random.uniform,
    "bytes": lambda key: jax.random.bits(key, (7,), "uint8"),
    "split": lambda key: jax.random.key_data(jax.random.split(key, (2, 3))),
    "folded": lambda key: jax.random.key_data(jax.random.fold_in(key, 7)),
    "nested": lambda key: jax.vmap(jax.random.normal)(jax.random.split(key, 6)),
}


@pytest.mark.parametrize("draw", DRAWS.values(), ids=DRAWS)
def test_the_numbers_are_jax_own(draw):
    keys = jax.random.split(jax.random.key(3), 2 * 3).reshape(2, 3)
    expected = jax.jit(jax.vmap(jax.vmap(draw)))(keys)
    drawn = jax.jit(jax.vmap(jax.vmap(lambda key: draw(quickly_compiled(key)))))(keys)
    np.testing.assert_array_equal(np.asarray(drawn), np.asarray(expected))


def test_on_the_cpu_the_blocks_are_flat():
    if jax.default_backend() != "cpu":
        pytest.skip("only the CPU's compiler unrolls short axes")
    keys = jax.random.split(jax.random.key(0), 4)
    draw = jax.vmap(lambda key: jax.random.uniform(quickly_compiled(key), (5, 3)))
    assert "tensor<60xui32>" in jax.jit(draw).lower(keys).as_text()
