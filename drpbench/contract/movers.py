"""Boxes that appear, move and vanish during an episode."""

from dataclasses import dataclass

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from drpbench.geometry import BOX, Primitives


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Movers:
    """Boxes in the world frame, M a world; `velocity` in m per control step. Only `active` ones
    exist."""

    half_size: Float[Array, "*boxes 3"]
    rotation: Float[Array, "*boxes 3 3"]
    position: Float[Array, "*boxes 3"]
    velocity: Float[Array, "*boxes 3"]
    active: Bool[Array, "*boxes"]

    @property
    def count(self) -> int:
        return self.half_size.shape[-2]

    def primitives(self) -> Primitives:
        """The same boxes as primitives, inactive ones masked."""
        return Primitives(
            kind=jnp.full(self.active.shape, BOX, jnp.int32),
            half_size=self.half_size,
            position=self.position,
            rotation=self.rotation,
            mask=self.active,
        )


def no_movers(count: int) -> Movers:
    """`count` boxes that do not exist (yet)."""
    zeros = jnp.zeros((count, 3))
    return Movers(
        half_size=jnp.full((count, 3), 0.05, jnp.float32),
        rotation=jnp.broadcast_to(jnp.eye(3), (count, 3, 3)),
        position=zeros,
        velocity=zeros,
        active=jnp.zeros(count, bool),
    )
