"""The random streams of an instance: they depend on nothing but the seed, the task and the
number."""

import zlib

import jax
import numpy as np
from jaxtyping import Array, Int, PRNGKeyArray

WORLD, POLICY = 0, 1
"""Streams of a run: what the world draws, and what its policy may draw from."""


def instance_key(
    seed: int, task: str, id: Int[Array, ""] | Int[np.ndarray, ""] | int, stream: int
) -> PRNGKeyArray:
    """The key of one instance and stream. Other streams than a run's are for other problems."""
    key = jax.random.fold_in(jax.random.key(seed), zlib.crc32(task.encode()) & 0x7FFFFFFF)
    return jax.random.fold_in(jax.random.fold_in(key, id), stream)
