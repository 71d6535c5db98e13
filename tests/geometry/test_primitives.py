"""Sets of primitives joined."""

import jax
import jax.numpy as jnp
import numpy as np

from drpbench.geometry import Primitives, concatenate


def stack(*batch, first=0.0):
    """Primitives with distinct numbers, `batch` their leading axes and count."""
    size = int(np.prod(batch))
    values = first + jnp.arange(size, dtype=jnp.float32).reshape(batch)
    return Primitives(
        kind=jnp.zeros(batch, jnp.int32),
        half_size=jnp.stack([values] * 3, axis=-1),
        position=jnp.stack([values] * 3, axis=-1),
        rotation=jnp.broadcast_to(jnp.eye(3), (*batch, 3, 3)),
        mask=jnp.ones(batch, bool),
    )


def test_concatenated_primitives_keep_their_order():
    both = concatenate(stack(2), stack(3, first=10.0))
    assert both.count == 5
    np.testing.assert_array_equal(both.position[:, 0], [0, 1, 10, 11, 12])
    assert both.rotation.shape == (5, 3, 3)


def test_batches_are_concatenated_world_by_world():
    both = concatenate(stack(4, 2), stack(4, 3, first=10.0))
    assert both.count == 5
    mapped = jax.vmap(concatenate)(stack(4, 2), stack(4, 3, first=10.0))
    for field, expected in zip(jax.tree.leaves(both), jax.tree.leaves(mapped), strict=True):
        np.testing.assert_array_equal(field, expected)


def test_nothing_can_be_concatenated():
    assert concatenate(stack(0), stack(3)).count == 3
