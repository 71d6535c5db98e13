"""Forward kinematics and Jacobians of the Panda in JAX.

Every fixed rotation of the chain is a quarter turn about x, so a joint costs two plane rotations and
no matrix product: nothing for TF32 to round.
"""

from dataclasses import dataclass

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from drpbench.compile import short_loops_unrolled

# Joint i+1 in its parent link: offset [m], and the quarter turns about x that precede the joint.
_OFFSETS = (
    (0.0, 0.0, 0.333),
    (0.0, 0.0, 0.0),
    (0.0, -0.316, 0.0),
    (0.0825, 0.0, 0.0),
    (-0.0825, 0.384, 0.0),
    (0.0, 0.0, 0.0),
    (0.088, 0.0, 0.0),
)
_QUARTER_TURNS = (0, -1, 1, 1, -1, 1, 1)
HAND_OFFSET = 0.107  # [m] along link7's z
GRIP_OFFSET = 0.1  # [m] from the hand frame along its z
_COS45 = 0.7071067811865476


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class LinkPoses:
    """World poses of link0 to link7 and the hand (index 8): 9 frames."""

    position: Float[Array, "*batch 9 3"]
    rotation: Float[Array, "*batch 9 3 3"]


def link_poses(q: Float[Array, "7"]) -> LinkPoses:
    """World poses of link0..link7 and the hand at joint positions `q` [rad]."""

    def joint(frame, fixed):
        origin, x, y, z = frame
        offset, turn, cos, sin = fixed
        origin = origin + offset[0] * x + offset[1] * y + offset[2] * z
        y, z = jnp.where(turn == 0, y, turn * z), jnp.where(turn == 0, z, -turn * y)
        x, y = cos * x + sin * y, cos * y - sin * x
        frame = (origin, x, y, z)
        return frame, frame

    base = (jnp.zeros(3, q.dtype), *jnp.eye(3, dtype=q.dtype))  # origin, and the axes x, y, z
    fixed = (jnp.asarray(_OFFSETS, q.dtype), jnp.asarray(_QUARTER_TURNS, q.dtype))
    chain = (*fixed, jnp.cos(q), jnp.sin(q))
    (origin, x, y, z), moving = jax.lax.scan(joint, base, chain, unroll=short_loops_unrolled())
    # The hand is turned by -45 degrees.
    hand = (origin + HAND_OFFSET * z, _COS45 * (x - y), _COS45 * (x + y), z)
    position, x, y, z = (
        jnp.concatenate([first[None], middle, last[None]])
        for first, middle, last in zip(base, moving, hand, strict=True)
    )
    return LinkPoses(position=position, rotation=jnp.stack([x, y, z], axis=-1))


def grip_pose(poses: LinkPoses) -> tuple[Float[Array, "3"], Float[Array, "3 3"]]:
    """Position [m] and rotation of the end-effector frame `grip`, 0.1 m beyond the hand frame."""
    rotation = poses.rotation[8]
    return poses.position[8] + GRIP_OFFSET * rotation[:, 2], rotation


def point_jacobian(
    poses: LinkPoses, point: Float[Array, "3"], link: Int[Array, ""] | int
) -> Float[Array, "3 7"]:
    """Jacobian [m/rad] of a world point that is fixed in frame `link` (0 to 8).

    Column j is z_j x (point - o_j) for the joints j up to the link, zero beyond.
    """
    axes, origins = poses.rotation[1:8, :, 2], poses.position[1:8]
    columns = jnp.cross(axes, point - origins)
    moves = jnp.arange(1, 8) <= jnp.minimum(link, 7)
    return jnp.where(moves[:, None], columns, 0.0).T


def grip_jacobian(poses: LinkPoses) -> Float[Array, "6 7"]:
    """Geometric Jacobian of the frame `grip`: linear [m/rad] above angular rows."""
    position, _ = grip_pose(poses)
    return jnp.concatenate([point_jacobian(poses, position, 8), poses.rotation[1:8, :, 2].T])
