"""What nearness costs a configuration, with its gradient and Gauss-Newton Hessian in closed form."""

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from drpbench.compile import stored
from drpbench.geometry import Primitives, nearest, normal
from drpbench.robot import PANDA, LinkPoses

# Of `Robot.self_collision_blocks` the large one: forearm, wrist and hand against base
# and shoulder. The other, link5 against the hand, hardly ever meets; the final check sees both.
_TRUNK, _HAND = (0, 1, 2), (5, 6, 7, 8)
_MODEL = PANDA.spheres
_MOVING = np.nonzero(_MODEL.link > 0)[0]
_OUTER = np.nonzero(np.isin(_MODEL.frame, _HAND))[0]
_INNER = np.nonzero(np.isin(_MODEL.frame, _TRUNK))[0]
_INDEX_RANGE = 32  # more than there are inner spheres


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Gaps:
    """Room [m] around spheres of the arm, by their surfaces; negative where they touch.

    `obstacle`: of the moving spheres, from the nearest obstacle; `own`: of the spheres of link5 to the
    hand, from the nearest sphere of link0 to link2.
    """

    obstacle: Float[Array, "*batch S"]
    own: Float[Array, "*batch O"]


def everywhere(room: float) -> Gaps:
    """The same room [m] around every sphere."""
    return Gaps(jnp.full(len(_MOVING), room), jnp.full(len(_OUTER), room))


def _own(points: Float[Array, "N 3"]) -> tuple[Array, Array, Array]:
    """Gap, direction, and frame of the inner sphere that is nearest, for each outer sphere.

    Distance, in micrometres, and index travel as one integer, as in `drpbench.geometry.distance`.
    """
    outer, inner = points[_OUTER], points[_INNER]
    radius = jnp.asarray(_MODEL.radius[_INNER])

    def visit(least, sphere):
        x, y, z, radius, index = sphere
        dx, dy, dz = outer[:, 0] - x, outer[:, 1] - y, outer[:, 2] - z
        gap = jnp.sqrt(dx * dx + dy * dy + dz * dz) - radius
        return jnp.minimum(least, (1.0e6 * gap).astype(jnp.int32) * _INDEX_RANGE + index), None

    start = jnp.full(len(_OUTER), 2**30, jnp.int32)
    spheres_in_turn = (inner[:, 0], inner[:, 1], inner[:, 2], radius, jnp.arange(len(_INNER)))
    least, _ = jax.lax.scan(visit, start, spheres_in_turn, unroll=True)
    which = stored(least & (_INDEX_RANGE - 1))
    apart = outer - inner[which]
    distance = jnp.sqrt(jnp.sum(apart * apart, axis=1))
    gap = distance - radius[which] - _MODEL.radius[_OUTER]
    return gap, apart / distance[:, None], jnp.asarray(_MODEL.frame[_INNER])[which]


def gaps(q: Float[Array, "7"], obstacles: Primitives) -> Gaps:
    """The room at joints `q` [rad] among `obstacles` (K,)."""
    points = _MODEL.world(PANDA.link_poses(q))
    distance, _ = nearest(points[_MOVING], obstacles)
    return Gaps(distance - _MODEL.radius[_MOVING], _own(points)[0])


def _rows(poses: LinkPoses, points, directions, above, frame):
    """(N, 7): how fast each point moves along its direction with each joint in (above, frame].

    n . (z x (p - o)) = z . (p x n) - n . (z x o): one cross product a point and one a joint.
    """
    axes, origins = poses.rotation[1:8, :, 2], poses.position[1:8]
    turn = jnp.einsum("kx,jx->kj", jnp.cross(points, directions), axes, precision="highest")
    shift = jnp.einsum("kx,jx->kj", directions, jnp.cross(axes, origins), precision="highest")
    joint = np.arange(1, 8)
    moves = (joint > above[:, None]) & (joint <= np.minimum(frame, 7)[:, None])
    return jnp.where(moves, turn - shift, 0.0)


def clearance_cost(
    q: Float[Array, "7"], obstacles: Primitives, activation: Gaps
) -> tuple[Float[Array, ""], Float[Array, "7"], Float[Array, "7 7"]]:
    """Cost [m^2], gradient and Gauss-Newton Hessian at joints `q` [rad], obstacles (K,) unbatched.

    With d_k the gaps of `Gaps` and a_k the `activation`:

        r_k = max(0, a_k - d_k)    cost = sum_k r_k^2 / 2    gradient = -J^T r    H = J^T J

    over the spheres with r_k > 0, J the gaps' derivative by q.
    """
    poses = PANDA.link_poses(q)
    points = _MODEL.world(poses)
    moving = points[_MOVING]
    distance, which = nearest(moving, obstacles)
    own, apart, above = _own(points)
    fixed = jnp.zeros(len(_MOVING), points.dtype)
    rows = _rows(
        poses,
        jnp.concatenate([moving, points[_OUTER]]),
        jnp.concatenate([normal(moving, obstacles, which), apart]),
        jnp.concatenate([fixed, above]),
        _MODEL.frame[np.concatenate([_MOVING, _OUTER])],
    )
    residual = jnp.concatenate(
        [
            activation.obstacle - (distance - _MODEL.radius[_MOVING]),
            activation.own - own,
        ]
    )
    residual = jnp.maximum(residual, 0.0)
    rows = jnp.where((residual > 0.0)[:, None], rows, 0.0)
    gradient = -jnp.einsum("kj,k->j", rows, residual, precision="highest")
    hessian = jnp.einsum("ki,kj->ij", rows, rows, precision="highest")
    return 0.5 * jnp.sum(residual * residual), gradient, hessian
