"""What nearness costs a configuration, with its gradient and Gauss-Newton Hessian in closed
form."""

from dataclasses import dataclass
from functools import cache

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from drpbench.compile import stored
from drpbench.geometry import Field
from drpbench.robot import PANDA, BodyPoints, Robot, directional_jacobian


@dataclass(frozen=True)
class _Spheres:
    """An arm's spheres, and which of them the cost looks at."""

    model: BodyPoints
    moving: np.ndarray
    """Against obstacles."""
    outer: np.ndarray
    inner: np.ndarray
    """The outer against the inner: the first of `Robot.self_collision_blocks`. The others hardly
    ever meet; the final check sees all."""

    @property
    def index_range(self) -> int:
        """A power of two, no less than there are inner spheres."""
        return 1 << (len(self.inner) - 1).bit_length()


@cache
def _spheres(robot: Robot) -> _Spheres:
    model = robot.spheres
    inner, outer = robot.self_collision_blocks[0] if robot.self_collision_blocks else ((), ())
    return _Spheres(
        model=model,
        moving=np.nonzero(model.frame > 0)[0],
        outer=np.nonzero(np.isin(model.frame, outer))[0],
        inner=np.nonzero(np.isin(model.frame, inner))[0],
    )


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Gaps:
    """Clearance [m] of spheres of the arm, by their surfaces; negative where they touch.

    `obstacle`: of the moving spheres, from the nearest obstacle; `own`: of the spheres of the
    second group of the first of `Robot.self_collision_blocks`, from the nearest sphere of its first
    group.
    """

    obstacle: Float[Array, "*batch S"]
    own: Float[Array, "*batch O"]


def everywhere(clearance: float, robot: Robot = PANDA) -> Gaps:
    """The same clearance [m] of every sphere."""
    spheres = _spheres(robot)
    return Gaps(
        jnp.full(len(spheres.moving), clearance),
        jnp.full(len(spheres.outer), clearance),
    )


def _own(
    points: Float[Array, "N 3"], spheres: _Spheres
) -> tuple[Float[Array, " O"], Float[Array, "O 3"], Int[Array, " O"]]:
    """Gap, direction, and frame of the inner sphere that is nearest, for each outer sphere.

    Distance, in micrometres, and index travel as one integer, as in `drpbench.geometry.distance`.
    """
    outer, inner = points[spheres.outer], points[spheres.inner]
    if not len(inner) or not len(outer):
        return jnp.zeros(0), jnp.zeros((0, 3)), jnp.zeros(0, jnp.int32)
    radius = jnp.asarray(spheres.model.radius[spheres.inner])
    index_range = spheres.index_range

    def visit(least, sphere):
        x, y, z, radius, index = sphere
        dx, dy, dz = outer[:, 0] - x, outer[:, 1] - y, outer[:, 2] - z
        gap = jnp.sqrt(dx * dx + dy * dy + dz * dz) - radius
        return jnp.minimum(least, (1.0e6 * gap).astype(jnp.int32) * index_range + index), None

    start = jnp.full(len(outer), 2**30, jnp.int32)
    in_turn = (inner[:, 0], inner[:, 1], inner[:, 2], radius, jnp.arange(len(inner)))
    least, _ = jax.lax.scan(visit, start, in_turn, unroll=True)
    which = stored(least & (index_range - 1))
    apart = outer - inner[which]
    distance = jnp.sqrt(jnp.sum(apart * apart, axis=1))
    gap = distance - radius[which] - spheres.model.radius[spheres.outer]
    frame = jnp.asarray(spheres.model.frame[spheres.inner])
    return gap, apart / distance[:, None], frame[which]


def gaps(q: Float[Array, " J"], obstacles: Field, robot: Robot = PANDA) -> Gaps:
    """The clearance at joints `q` [rad] among `obstacles`."""
    spheres = _spheres(robot)
    points = spheres.model.world(robot.link_poses(q))
    # By the same function as the cost's: in another, what is nearest may differ by a rounding.
    distance, _ = obstacles.distance_and_normal(points[spheres.moving])
    return Gaps(distance - spheres.model.radius[spheres.moving], _own(points, spheres)[0])


def clearance_cost(
    q: Float[Array, " J"], obstacles: Field, activation: Gaps, robot: Robot = PANDA
) -> tuple[Float[Array, ""], Float[Array, " J"], Float[Array, "J J"]]:
    """Cost [m^2], gradient and Gauss-Newton Hessian at joints `q` [rad] among `obstacles`.

    With d_k the gaps of `Gaps` and a_k the `activation`:

        r_k = max(0, a_k - d_k)    cost = sum_k r_k^2 / 2    gradient = -J^T r    H = J^T J

    over the spheres with r_k > 0, J the gaps' derivative by q.
    """
    spheres = _spheres(robot)
    model, moving = spheres.model, spheres.moving
    poses = robot.link_poses(q)
    points = model.world(poses)
    distance, normal = obstacles.distance_and_normal(points[moving])
    own, apart, above = _own(points, spheres)
    rows = directional_jacobian(
        poses,
        jnp.concatenate([points[moving], points[spheres.outer]]),
        jnp.concatenate([normal, apart]),
        jnp.concatenate([jnp.zeros(len(moving), above.dtype), above]),
        model.frame[np.concatenate([moving, spheres.outer])],
    )
    residual = jnp.concatenate(
        [activation.obstacle - (distance - model.radius[moving]), activation.own - own]
    )
    residual = jnp.maximum(residual, 0.0)
    rows = jnp.where((residual > 0.0)[:, None], rows, 0.0)
    gradient = -jnp.einsum("kj,k->j", rows, residual, precision="highest")
    hessian = jnp.einsum("ki,kj->ij", rows, rows, precision="highest")
    return 0.5 * jnp.sum(residual * residual), gradient, hessian
