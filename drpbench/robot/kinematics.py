"""Forward kinematics and Jacobians of the Panda in JAX, by components.

Every fixed rotation of the chain is a quarter turn about x, so a joint costs two plane rotations and
no matrix product: nothing for the compiler to duplicate, and nothing for TF32 to round.
"""

from dataclasses import dataclass

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

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


def _step(x, y, z, cos, sin):
    """Columns of R Rz(angle), from the columns of R."""
    return (
        tuple(cos * a + sin * b for a, b in zip(x, y, strict=True)),
        tuple(cos * b - sin * a for a, b in zip(x, y, strict=True)),
        z,
    )


def _chain(q):
    """Origins and axis columns of the nine frames, as nested tuples of scalars."""
    o, x, y, z = (0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
    frames = [(o, x, y, z)]
    for i, (offset, turn) in enumerate(zip(_OFFSETS, _QUARTER_TURNS, strict=True)):
        o = tuple(o[k] + offset[0] * x[k] + offset[1] * y[k] + offset[2] * z[k] for k in range(3))
        if turn > 0:
            y, z = z, tuple(-c for c in y)
        elif turn < 0:
            y, z = tuple(-c for c in z), y
        x, y, z = _step(x, y, z, jnp.cos(q[i]), jnp.sin(q[i]))
        frames.append((o, x, y, z))
    o = tuple(o[k] + HAND_OFFSET * z[k] for k in range(3))
    x, y, z = _step(x, y, z, _COS45, -_COS45)  # the hand is turned by -45 degrees
    frames.append((o, x, y, z))
    return frames


def link_poses(q: Float[Array, "7"]) -> LinkPoses:
    """World poses of link0..link7 and the hand at joint positions `q` [rad]."""
    frames = _chain(q)
    zero = jnp.zeros((), q.dtype)
    position = jnp.stack([jnp.stack([c + zero for c in o]) for o, *_ in frames])
    rotation = jnp.stack(
        [
            jnp.stack([jnp.stack([axes[j][i] + zero for j in range(3)]) for i in range(3)])
            for _, *axes in frames
        ]
    )
    return LinkPoses(position=position, rotation=rotation)


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
