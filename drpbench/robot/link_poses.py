"""Where an arm's frames are, and how points fixed in them move with the joints."""

from dataclasses import dataclass

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class LinkPoses:
    """World poses of an arm's F = J + 2 frames: the base, the J joints' links, and the hand."""

    position: Float[Array, "*batch F 3"]
    rotation: Float[Array, "*batch F 3 3"]

    @property
    def axes(self) -> Float[Array, "*batch J 3"]:
        """World directions z_j of the joints' axes."""
        return self.rotation[..., 1:-1, :, 2]

    @property
    def origins(self) -> Float[Array, "*batch J 3"]:
        """World points o_j [m] on the joints' axes."""
        return self.position[..., 1:-1, :]


def point_jacobian(
    poses: LinkPoses, point: Float[Array, "3"], frame: Int[Array, ""] | int
) -> Float[Array, "3 J"]:
    """Jacobian [m/rad] of a world point that is fixed in a frame (0 to J + 1).

    Column j is z_j x (point - o_j) for the joints j up to the frame, zero beyond.
    """
    axes, origins = poses.axes, poses.origins
    joints = len(axes)
    columns = jnp.cross(axes, point - origins)
    moves = jnp.arange(1, joints + 1) <= jnp.minimum(frame, joints)
    return jnp.where(moves[:, None], columns, 0.0).T
