"""Boxes, cylinders and spheres as one batched, masked pytree."""

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

BOX, CYLINDER, SPHERE = 0, 1, 2
SHAPES = ("box", "cylinder", "sphere")
MAX_OBSTACLES = 24
"""A scene's obstacles, at most."""


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Primitives:
    """A set of K solid primitives in the world frame, batched over any leading axes.

    `half_size` is, in the primitive's own frame: a box's half extents; (radius, radius, half
    height) of a cylinder about z; (radius, radius, radius) of a sphere [m]. `rotation` takes the
    primitive's frame to the world's. Where `mask` is false there is no primitive.
    """

    kind: Int[Array, "*batch K"] | Int[np.ndarray, "*batch K"]
    half_size: Float[Array, "*batch K 3"] | Float[np.ndarray, "*batch K 3"]
    position: Float[Array, "*batch K 3"] | Float[np.ndarray, "*batch K 3"]
    rotation: Float[Array, "*batch K 3 3"] | Float[np.ndarray, "*batch K 3 3"]
    mask: Bool[Array, "*batch K"] | Bool[np.ndarray, "*batch K"]

    @property
    def count(self) -> int:
        """K, masked ones included."""
        return self.kind.shape[-1]

    # A `Field`. Of one world: K primitives without further axes.

    def distance(self, points: Float[Array, "*points 3"]) -> Float[Array, "*points"]:
        """`signed_distance` [m] from each point to the primitives."""
        from .distance import signed_distance  # which knows Primitives

        return signed_distance(points, self)

    def distance_and_normal(
        self, points: Float[Array, "*points 3"]
    ) -> tuple[Float[Array, "*points"], Float[Array, "*points 3"]]:
        """The distance [m] from each point to the `nearest` primitive, and the `normal` of that."""
        from .distance import nearest, normal

        distance, which = nearest(points, self)
        if self.count == 0:
            return distance, jnp.zeros_like(points)
        return distance, normal(points, self, which)


def concatenate(first: Primitives, second: Primitives) -> Primitives:
    """Both sets as one: `first`'s primitives keep their indices. Leading axes must agree."""
    batch = first.kind.ndim
    return jax.tree.map(lambda a, b: jnp.concatenate([a, b], axis=batch - 1), first, second)
