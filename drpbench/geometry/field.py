"""What planning asks of obstacles: how far they are, and in which direction."""

from typing import Protocol, runtime_checkable

from jaxtyping import Array, Float


@runtime_checkable
class Field(Protocol):
    """A signed distance field of one world's obstacles [m], negative inside them.

    A field is registered as a JAX pytree: its arrays are its leaves, its settings static. It has no
    batch axes of its own: vmap over worlds. `Primitives` is one; a voxel grid or a mesh can be
    another.
    """

    def distance(self, points: Float[Array, "*points 3"]) -> Float[Array, "*points"]:
        """Signed distance [m] from each point to the nearest obstacle; `FAR` where there is
        none."""
        ...

    def distance_and_normal(
        self, points: Float[Array, "*points 3"]
    ) -> tuple[Float[Array, "*points"], Float[Array, "*points 3"]]:
        """`distance`, and its unit gradient in the world frame.

        The gradient points away from the nearest obstacle. Where it does not exist, or where there
        is no obstacle, it is any direction.
        """
        ...
