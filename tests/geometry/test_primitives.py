"""Sets of primitives joined, and rotations between their two forms."""

import jax
import jax.numpy as jnp
import numpy as np
from scipy.spatial.transform import Rotation

from drpbench.geometry import Primitives, concatenate, matrix_to_quaternion, quaternion_to_matrix


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


def test_quaternions_give_scipys_matrices():
    turns = Rotation.random(200, rng=np.random.default_rng(0))
    quaternion = jnp.asarray(turns.as_quat(scalar_first=True), jnp.float32)
    matrices = quaternion_to_matrix(quaternion)
    np.testing.assert_allclose(matrices, turns.as_matrix(), atol=1e-6)
    batched = quaternion_to_matrix(quaternion.reshape(4, 50, 4))
    np.testing.assert_array_equal(batched.reshape(-1, 3, 3), matrices)


def test_matrices_give_back_their_quaternions():
    random = Rotation.random(200, rng=np.random.default_rng(1))
    # Half turns, where w is zero, and the turns around them.
    axes = np.concatenate([np.eye(3), [[0.6, 0.8, 0.0], [0.6, 0.0, -0.8], [0.0, 0.6, 0.8]]])
    half = Rotation.from_rotvec(np.concatenate([axes * a for a in (0.0, np.pi, np.pi - 1e-4, -3)]))
    for turns in (random, half):
        found = matrix_to_quaternion(jnp.asarray(turns.as_matrix(), jnp.float32))
        np.testing.assert_allclose(np.linalg.norm(found, axis=-1), 1.0, atol=1e-6)
        expected = turns.as_quat(scalar_first=True)
        # q and -q are one rotation.
        np.testing.assert_allclose(np.abs(np.sum(found * expected, axis=-1)), 1.0, atol=1e-6)
        np.testing.assert_allclose(quaternion_to_matrix(found), turns.as_matrix(), atol=2e-6)
