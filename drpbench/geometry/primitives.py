"""Boxes, cylinders and spheres as one batched, masked pytree."""

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

BOX, CYLINDER, SPHERE = 0, 1, 2
SHAPES = ("box", "cylinder", "sphere")


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Primitives:
    """A set of K solid primitives in the world frame, batched over any leading axes.

    `half_size` is, in the primitive's own frame: a box's half extents; (radius, radius, half height)
    of a cylinder about z; (radius, radius, radius) of a sphere [m]. `rotation` takes the primitive's
    frame to the world's. Where `mask` is false there is no primitive.
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


def concatenate(first: Primitives, second: Primitives) -> Primitives:
    """Both sets as one: `first`'s primitives keep their indices. Leading axes must agree."""
    batch = first.kind.ndim
    return jax.tree.map(lambda a, b: jnp.concatenate([a, b], axis=batch - 1), first, second)


def quaternion_to_matrix(quaternion: Float[Array, "*batch 4"]) -> Float[Array, "*batch 3 3"]:
    """Rotation matrix of a unit quaternion, wxyz."""
    w, x, y, z = (quaternion[..., i] for i in range(4))
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return jnp.stack([jnp.stack(row, axis=-1) for row in rows], axis=-2)
