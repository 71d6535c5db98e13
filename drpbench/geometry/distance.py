"""Signed distance from points to primitives, and its gradient, in closed form.

Every primitive is folded onto a box. In its own frame, with p = (x, y, z):

    box       u = (|x|, |y|, |z|)              minus half extents
    cylinder  u = (sqrt(x^2 + y^2), -, |z|)    minus (radius, -, half height)
    sphere    u = (|p|, -, -)                  minus (radius, -, -)

with "-" an axis that never binds, so that one formula serves all three:

    d = |max(u, 0)| + min(max(u_x, u_y, u_z), 0)

The scan over the primitives keeps a running minimum, all by components: nothing of size
points x primitives is ever stored.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from drpbench.compile import stored

from .primitives import BOX, SPHERE, Primitives

FAR = 1.0e6  # [m] distance to a set without primitives
_NEVER = -1.0e6  # a folded coordinate that never binds
_TINY = 1.0e-12


def _fields(primitives: Primitives):
    half = tuple(primitives.half_size[..., i] for i in range(3))
    position = tuple(primitives.position[..., i] for i in range(3))
    rotation = tuple(primitives.rotation[..., i, j] for i in range(3) for j in range(3))
    return primitives.kind, half, position, rotation, primitives.mask


def _local(point, position, r):
    """Coordinates of `point` in a primitive's frame: R^T (point - position), by components."""
    dx, dy, dz = (a - b for a, b in zip(point, position, strict=True))
    return (
        r[0] * dx + r[3] * dy + r[6] * dz,
        r[1] * dx + r[4] * dy + r[7] * dz,
        r[2] * dx + r[5] * dy + r[8] * dz,
    )


def _fold(local, kind, half):
    """The folded coordinates u and the radius they were folded with."""
    x, y, z = local
    is_box, is_sphere = kind == BOX, kind == SPHERE
    height = jnp.where(is_sphere, z, 0.0)
    radius = jnp.sqrt(x * x + y * y + height * height)
    u = jnp.where(is_box, jnp.abs(x), radius) - half[0]
    v = jnp.where(is_box, jnp.abs(y) - half[1], _NEVER)
    w = jnp.where(is_sphere, _NEVER, jnp.abs(z) - half[2])
    return (u, v, w), radius


def _distance(u, v, w):
    a, b, c = jnp.maximum(u, 0.0), jnp.maximum(v, 0.0), jnp.maximum(w, 0.0)
    return jnp.sqrt(a * a + b * b + c * c) + jnp.minimum(jnp.maximum(jnp.maximum(u, v), w), 0.0)


def _to_one(point, field):
    """Signed distance of points, by components, to one primitive's fields."""
    kind, half, position, rotation, mask = field
    folded, _ = _fold(_local(point, position, rotation), kind, half)
    return jnp.where(mask, _distance(*folded), FAR)


def nearest(
    points: Float[Array, "*points 3"], primitives: Primitives
) -> tuple[Float[Array, "*points"], Int[Array, "*points"]]:
    """Signed distance [m] from each point to the nearest of K primitives, and which one it is.

    Negative inside. `FAR` and index 0 where every primitive is masked. `primitives` has no batch axes
    of its own: vmap over worlds. For the distance alone `signed_distance` is twice as fast.
    """
    point = tuple(points[..., i] for i in range(3))

    def visit(carry, field):
        best, which, index = carry
        distance = _to_one(point, field)
        closer = distance < best
        return (jnp.where(closer, distance, best), jnp.where(closer, index, which), index + 1), None

    start = (
        jnp.full(points.shape[:-1], FAR, points.dtype),
        jnp.zeros(points.shape[:-1], jnp.int32),
        jnp.int32(0),
    )
    (best, which, _), _ = jax.lax.scan(visit, start, _fields(primitives))
    return best, which


def normal(
    points: Float[Array, "*points 3"], primitives: Primitives, which: Int[Array, "*points"]
) -> Float[Array, "*points 3"]:
    """Unit gradient of the signed distance to primitive `which` at each point, in the world frame.

    Outside, it points away from the nearest surface point; inside, along the axis that leads out
    soonest. Where the gradient does not exist (a sphere's centre, a cylinder's axis) one valid
    direction is returned.
    """
    kind, half, position, r, _ = jax.tree.map(lambda field: field[which], _fields(primitives))
    point = tuple(points[..., i] for i in range(3))
    x, y, z = _local(point, position, r)
    (u, v, w), radius = _fold((x, y, z), kind, half)

    # In folded coordinates.
    a, b, c = jnp.maximum(u, 0.0), jnp.maximum(v, 0.0), jnp.maximum(w, 0.0)
    length = jnp.sqrt(a * a + b * b + c * c)
    outside = length > 0.0
    scale = 1.0 / jnp.maximum(length, _TINY)
    first = (u >= v) & (u >= w)
    second = ~first & (v >= w)
    gu = jnp.where(outside, a * scale, first.astype(points.dtype))
    gv = jnp.where(outside, b * scale, second.astype(points.dtype))
    gw = jnp.where(outside, c * scale, (~first & ~second).astype(points.dtype))

    # Unfolded: a radial coordinate spreads over the axes it was made of.
    is_box, is_sphere = kind == BOX, kind == SPHERE
    safe = radius > _TINY
    radial = gu / jnp.where(safe, radius, 1.0)
    nx = jnp.where(is_box, jnp.copysign(gu, x), jnp.where(safe, radial * x, gu))
    ny = jnp.where(is_box, jnp.copysign(gv, y), jnp.where(safe, radial * y, 0.0))
    nz = jnp.where(is_sphere, jnp.where(safe, radial * z, 0.0), jnp.copysign(gw, z))
    return jnp.stack(
        [
            r[0] * nx + r[1] * ny + r[2] * nz,
            r[3] * nx + r[4] * ny + r[5] * nz,
            r[6] * nx + r[7] * ny + r[8] * nz,
        ],
        axis=-1,
    )


@jax.custom_jvp
def signed_distance(
    points: Float[Array, "*points 3"], primitives: Primitives
) -> Float[Array, "*points"]:
    """Signed distance [m] from each point to the union of the primitives; negative inside.

    `FAR` where every primitive is masked. Differentiable in `points` only, by the nearest primitive's
    closed-form normal.
    """
    point = tuple(points[..., i] for i in range(3))
    # Unrolled, the running minimum stays in registers.
    best, _ = jax.lax.scan(
        lambda best, field: (jnp.minimum(best, _to_one(point, field)), None),
        jnp.full(points.shape[:-1], FAR, points.dtype),
        _fields(primitives),
        unroll=max(primitives.count, 1),
    )
    return stored(best)


@signed_distance.defjvp
def _signed_distance_jvp(primals, tangents):
    points, primitives = primals
    distance, which = nearest(points, primitives)
    direction = normal(points, primitives, which)
    slope = jnp.where(distance < FAR, jnp.sum(direction * tangents[0], axis=-1), 0.0)
    return distance, slope
