"""Rotations as unit quaternions (w, x, y, z) and as matrices, batched over any leading axes."""

from typing import overload

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float


@overload
def quaternion_to_matrix(quaternion: Float[Array, "*batch 4"]) -> Float[Array, "*batch 3 3"]: ...
@overload
def quaternion_to_matrix(
    quaternion: Float[np.ndarray, "*batch 4"],
) -> Float[np.ndarray, "*batch 3 3"]: ...
def quaternion_to_matrix(
    quaternion: Float[Array, "*batch 4"] | Float[np.ndarray, "*batch 4"],
) -> Float[Array, "*batch 3 3"] | Float[np.ndarray, "*batch 3 3"]:
    """Rotation matrices of unit quaternions; computed by JAX for its arrays, by NumPy for its
    own."""
    xp = jnp if isinstance(quaternion, jax.Array) else np
    w, x, y, z = (quaternion[..., i] for i in range(4))
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return xp.stack([xp.stack(row, axis=-1) for row in rows], axis=-2)


def rotation_angle(
    first: Float[Array, "*batch 3 3"], second: Float[Array, "*batch 3 3"]
) -> Float[Array, "*batch"]:
    """Angle [rad] between two rotations, exact near 0 too: |R1 - R2|_F = 2 sqrt(2) sin(angle /
    2)."""
    turn = first - second
    sine = jnp.sqrt(jnp.sum(turn * turn, axis=(-2, -1))) / (2.0 * jnp.sqrt(2.0))
    return 2.0 * jnp.arcsin(jnp.minimum(sine, 1.0))


def matrix_to_quaternion(rotation: Float[Array, "*batch 3 3"]) -> Float[Array, "*batch 4"]:
    """Unit quaternion wxyz of a rotation matrix, w or the largest component positive.

    Each row below is 4 times one component times the quaternion; the longest is the best
    conditioned.
    """
    r = rotation
    xx, yy, zz = r[..., 0, 0], r[..., 1, 1], r[..., 2, 2]
    wx, wy, wz = (
        r[..., 2, 1] - r[..., 1, 2],
        r[..., 0, 2] - r[..., 2, 0],
        r[..., 1, 0] - r[..., 0, 1],
    )
    xy, xz, yz = (
        r[..., 1, 0] + r[..., 0, 1],
        r[..., 0, 2] + r[..., 2, 0],
        r[..., 2, 1] + r[..., 1, 2],
    )
    rows = jnp.stack(
        [
            jnp.stack([1 + xx + yy + zz, wx, wy, wz], axis=-1),
            jnp.stack([wx, 1 + xx - yy - zz, xy, xz], axis=-1),
            jnp.stack([wy, xy, 1 - xx + yy - zz, yz], axis=-1),
            jnp.stack([wz, xz, yz, 1 - xx - yy + zz], axis=-1),
        ],
        axis=-2,
    )
    lengths = jnp.linalg.norm(rows, axis=-1)
    longest = jnp.argmax(lengths, axis=-1)
    chosen = jnp.take_along_axis(rows, longest[..., None, None], axis=-2)[..., 0, :]
    return chosen / jnp.linalg.norm(chosen, axis=-1, keepdims=True)
