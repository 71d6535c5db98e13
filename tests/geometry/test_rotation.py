"""Rotations between their two forms, for arrays of JAX and of NumPy."""

import jax
import jax.numpy as jnp
import numpy as np
from scipy.spatial.transform import Rotation

from drpbench.geometry import matrix_to_quaternion, quaternion_to_matrix


def test_quaternions_give_scipys_matrices():
    turns = Rotation.random(200, rng=np.random.default_rng(0))
    quaternion = jnp.asarray(turns.as_quat(scalar_first=True), jnp.float32)
    matrices = quaternion_to_matrix(quaternion)
    np.testing.assert_allclose(matrices, turns.as_matrix(), atol=1e-6)
    batched = quaternion_to_matrix(quaternion.reshape(4, 50, 4))
    np.testing.assert_array_equal(batched.reshape(-1, 3, 3), matrices)


def test_each_array_library_gets_its_own_back():
    quaternion = Rotation.random(50, rng=np.random.default_rng(2)).as_quat(scalar_first=True)
    on_host = quaternion_to_matrix(quaternion)
    assert type(on_host) is np.ndarray and on_host.dtype == np.float64
    np.testing.assert_allclose(
        on_host, Rotation.from_quat(quaternion, scalar_first=True).as_matrix()
    )
    single = quaternion.astype(np.float32)
    by_jax = quaternion_to_matrix(jnp.asarray(single))
    assert isinstance(by_jax, jax.Array)
    assert quaternion_to_matrix(single).dtype == np.float32
    np.testing.assert_allclose(by_jax, quaternion_to_matrix(single), atol=1e-6)
    assert quaternion_to_matrix(quaternion[0]).shape == (3, 3)


def test_a_traced_quaternion_is_jaxs():
    quaternion = np.array([0.5, 0.5, 0.5, 0.5], np.float32)
    np.testing.assert_allclose(
        jax.jit(quaternion_to_matrix)(quaternion), [[0, 0, 1], [1, 0, 0], [0, 1, 0]], atol=1e-6
    )


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
