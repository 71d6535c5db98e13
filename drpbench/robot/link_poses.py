"""Where an arm's frames are, and how points fixed in them move with the joints."""

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
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


def directional_jacobian(
    poses: LinkPoses,
    points: Float[Array, "N 3"],
    directions: Float[Array, "N 3"],
    above: Int[Array, " N"],
    frame: Int[Array, " N"] | Int[np.ndarray, " N"],
) -> Float[Array, "N J"]:
    """How fast each world point p moves along its direction n with each joint [m/rad].

    The point is fixed in `frame` (0 to J + 1) and seen from the frame `above`: only the joints
    between the two count. This is n . `point_jacobian`, as n . (z x (p - o)) = z . (p x n) - n . (z
    x o): one cross product a point and one a joint.
    """
    axes, origins = poses.axes, poses.origins
    turn = jnp.einsum("kx,jx->kj", jnp.cross(points, directions), axes, precision="highest")
    shift = jnp.einsum("kx,jx->kj", directions, jnp.cross(axes, origins), precision="highest")
    joints = len(axes)
    joint = np.arange(1, joints + 1)
    moves = (joint > above[:, None]) & (joint <= np.minimum(frame, joints)[:, None])
    return jnp.where(moves, turn - shift, 0.0)
