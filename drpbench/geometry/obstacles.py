"""Scenes as arrays: what problems, generators, checkers and files pass on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from .primitives import BOX, Primitives
from .rotation import quaternion_to_matrix

_FILLER = 0.01  # [m] half size: a proper box, so that geometry on padded arrays stays finite


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Obstacles:
    """K obstacles in the world frame, one scene or a batch of them. Lengths [m], quaternions wxyz.

    `kind` and `half_size` as in `Primitives`. Where `mask` is false there is no obstacle. On the
    host the arrays are numpy's, and become the device's by `primitives`.
    """

    kind: Int[Array, "*batch K"] | Int[np.ndarray, "*batch K"]
    half_size: Float[Array, "*batch K 3"] | Float[np.ndarray, "*batch K 3"]
    position: Float[Array, "*batch K 3"] | Float[np.ndarray, "*batch K 3"]
    quaternion: Float[Array, "*batch K 4"] | Float[np.ndarray, "*batch K 4"]
    mask: Bool[Array, "*batch K"] | Bool[np.ndarray, "*batch K"]

    @classmethod
    def of(
        cls, kind: np.ndarray, half_size: np.ndarray, position: np.ndarray, quaternion: np.ndarray
    ) -> Obstacles:
        """Obstacles that are all there: arrays (*batch, K), (*batch, K, 3), (..., 3) and (...,
        4)."""
        return cls(kind, half_size, position, quaternion, np.ones(np.shape(kind), bool))

    @classmethod
    def boxes(
        cls, half_size: np.ndarray, position: np.ndarray, quaternion: np.ndarray
    ) -> Obstacles:
        """Boxes (*batch, K, 3) that are all there."""
        return cls.of(np.full(half_size.shape[:-1], BOX, np.int32), half_size, position, quaternion)

    @classmethod
    def absent(cls, *shape: int) -> Obstacles:
        """Slots (*batch, K) without an obstacle: masked boxes of 1 cm at the origin."""
        return cls(
            kind=np.full(shape, BOX, np.int32),
            half_size=np.full((*shape, 3), _FILLER, np.float32),
            position=np.zeros((*shape, 3), np.float32),
            quaternion=np.tile(np.array([1, 0, 0, 0], np.float32), (*shape, 1)),
            mask=np.zeros(shape, bool),
        )

    @property
    def count(self) -> int:
        """K, masked ones included."""
        return self.kind.shape[-1]

    def __getitem__(self, index: Any) -> Obstacles:
        """The scenes of a batch that `index` picks from its first axes."""
        return Obstacles(**{f.name: getattr(self, f.name)[index] for f in fields(self)})

    def present(self) -> Obstacles:
        """Those of one scene that are there, on the host."""
        return self[np.asarray(self.mask)]

    def joined(self, other: Obstacles) -> Obstacles:
        """Both as one, on the host; these keep their indices. Leading axes must agree."""
        axis = self.kind.ndim - 1
        return jax.tree.map(lambda a, b: np.concatenate([a, b], axis=axis), self, other)

    def padded(self, width: int) -> Obstacles:
        """The same with K = `width`, on the host. Raises ValueError where that is too few."""
        *batch, count = self.kind.shape
        if count > width:
            raise ValueError(f"{count} obstacles do not fit {width} slots")
        return self.joined(Obstacles.absent(*batch, width - count))

    def primitives(self) -> Primitives:
        """The obstacles for the device, float32. What is numpy's stays numpy's."""
        rotation = quaternion_to_matrix(jnp.asarray(self.quaternion, jnp.float32))
        if not isinstance(self.quaternion, np.ndarray):
            return Primitives(self.kind, self.half_size, self.position, rotation, self.mask)
        return Primitives(
            kind=np.asarray(self.kind, np.int32),
            half_size=np.asarray(self.half_size, np.float32),
            position=np.asarray(self.position, np.float32),
            rotation=np.asarray(rotation),
            mask=np.asarray(self.mask),
        )


def stacked(scenes: Sequence[Obstacles]) -> Obstacles:
    """Scenes of one width as a batch, on the host."""
    return jax.tree.map(lambda *arrays: np.stack(arrays), *scenes)
