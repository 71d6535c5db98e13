"""Signed distance from points to primitives, and its gradient, in closed form.

Every primitive is folded onto a box. In its own frame, with p = (x, y, z):

    box       u = (|x|, |y|, |z|)              minus half extents
    cylinder  u = (sqrt(x^2 + y^2), -, |z|)    minus (radius, -, half height)
    sphere    u = (|p|, -, -)                  minus (radius, -, -)

with "-" an axis that never binds, so that one formula serves all three:

    d = |max(u, 0)| + min(max(u_x, u_y, u_z), 0)

A search over the primitives keeps a running minimum, all by components: nothing of size
points x primitives is ever stored.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from drpbench.compile import stored

from .primitives import BOX, SPHERE, Primitives

FAR = 1.0e6  # [m] distance to a set without primitives
_TINY = 1.0e-12


def _rows(primitives: Primitives) -> tuple[Float[Array, " K"], ...]:
    """What the folding needs to know of each primitive, by components.

    Half sizes of the folded box; whether y and z go into the first coordinate (1 or 0); position;
    rotation. An axis that never binds is FAR thick, and what is masked is FAR away.
    """
    primitives = jax.tree.map(jnp.asarray, primitives)
    position, rotation = jnp.asarray(primitives.position), jnp.asarray(primitives.rotation)
    is_round, is_sphere = primitives.kind != BOX, primitives.kind == SPHERE
    half = tuple(primitives.half_size[..., i] for i in range(3))
    return (
        jnp.where(primitives.mask, half[0], -FAR),
        jnp.where(is_round, FAR, half[1]),
        jnp.where(is_sphere, FAR, half[2]),
        is_round.astype(half[0].dtype),
        is_sphere.astype(half[0].dtype),
        *(position[..., i] for i in range(3)),
        *(rotation[..., i, j] for i in range(3) for j in range(3)),
    )


def _pick(rows, which):
    """The rows of the primitives that `which` names: one gather, because each costs as much as
    all."""
    picked = jnp.stack(rows, axis=-1)[which]
    return tuple(picked[..., i] for i in range(len(rows)))


def _fold(point, row):
    """Coordinates in the primitive's frame, the folded u, and the radius that u_x was made of."""
    half, (y_in, z_in), position, r = row[:3], row[3:5], row[5:8], row[8:]
    dx, dy, dz = (a - b for a, b in zip(point, position, strict=True))
    x = r[0] * dx + r[3] * dy + r[6] * dz
    y = r[1] * dx + r[4] * dy + r[7] * dz
    z = r[2] * dx + r[5] * dy + r[8] * dz
    radius = jnp.sqrt(x * x + y_in * (y * y) + z_in * (z * z))
    return (x, y, z), (radius - half[0], jnp.abs(y) - half[1], jnp.abs(z) - half[2]), radius


def _larger(a, b):
    """jnp.maximum, but NaN only where `a` is: looking for it in both doubles the cost."""
    return jnp.where(b > a, b, a)


def _distance(point, row):
    """Signed distance of points, by components, to one primitive each. NaN where a point is."""
    _, (u, v, w), _ = _fold(point, row)
    a, b, c = _larger(u, 0.0), _larger(v, 0.0), _larger(w, 0.0)
    most = _larger(_larger(u, v), w)
    return jnp.sqrt(a * a + b * b + c * c) + jnp.where(most < 0.0, most, 0.0)


def _search(point, rows):
    """Index of the nearest primitive of each point.

    Distance and index travel as one integer, the index in the lowest bits: one running minimum
    instead of two that depend on each other, which XLA on the CPU computes again for each other.
    """
    index_bits = (1 << (rows[0].shape[-1] - 1).bit_length()) - 1

    def visit(carry, row):
        least, index = carry
        distance = _distance(point, row).astype(jnp.float32)
        bits = jax.lax.bitcast_convert_type(distance, jnp.int32)
        ordered = bits ^ ((bits >> 31) & 0x7FFFFFFF)  # integers in the order of the floats
        return (jnp.minimum(least, (ordered & ~index_bits) | index), index + 1), None

    start = jnp.full(point[0].shape, 2**31 - 1, jnp.int32)
    (least, _), _ = jax.lax.scan(visit, (start, jnp.int32(0)), rows, unroll=True)
    return stored(least & index_bits)


def _gradient(point, row):
    """Unit gradient of `_distance`, by components."""
    (x, y, z), (u, v, w), radius = _fold(point, row)
    (y_in, z_in), r = row[3:5], row[8:]

    # In folded coordinates.
    a, b, c = jnp.maximum(u, 0.0), jnp.maximum(v, 0.0), jnp.maximum(w, 0.0)
    length = jnp.sqrt(a * a + b * b + c * c)
    outside = length > 0.0
    scale = 1.0 / jnp.where(outside, length, 1.0)
    first = (u >= v) & (u >= w)
    second = ~first & (v >= w)
    gu = jnp.where(outside, a * scale, jnp.where(first, 1.0, 0.0))
    gv = jnp.where(outside, b * scale, jnp.where(second, 1.0, 0.0))
    gw = jnp.where(outside, c * scale, jnp.where(first | second, 0.0, 1.0))

    # Unfolded: u_x spreads over the axes it was made of; gv and gw are zero where theirs never
    # bind.
    safe = radius > _TINY
    radial = gu / jnp.where(safe, radius, 1.0)
    nx = jnp.where(safe, radial * x, gu)
    ny = radial * y_in * y + jnp.copysign(gv, y)
    nz = radial * z_in * z + jnp.copysign(gw, z)
    return (
        r[0] * nx + r[1] * ny + r[2] * nz,
        r[3] * nx + r[4] * ny + r[5] * nz,
        r[6] * nx + r[7] * ny + r[8] * nz,
    )


def _components(points):
    return tuple(points[..., i] for i in range(3))


def nearest(
    points: Float[Array, "*points 3"], primitives: Primitives
) -> tuple[Float[Array, "*points"], Int[Array, "*points"]]:
    """Signed distance [m] from each point to the nearest of K primitives, and which one it is.

    Negative inside. `FAR` and index 0 where every primitive is masked. `primitives` has no batch
    axes of its own: vmap over worlds. Of primitives whose distances agree to one part in 4 million
    / K, any may be taken. For the distance alone `signed_distance` is faster.
    """
    if primitives.count == 0:
        shape = points.shape[:-1]
        return jnp.full(shape, FAR, points.dtype), jnp.zeros(shape, jnp.int32)
    point, rows = _components(points), _rows(primitives)
    which = _search(point, rows)
    distance = jnp.minimum(_distance(point, _pick(rows, which)), FAR)
    return distance, jnp.where(distance < FAR, which, 0)


def normal(
    points: Float[Array, "*points 3"], primitives: Primitives, which: Int[Array, "*points"]
) -> Float[Array, "*points 3"]:
    """Unit gradient of the signed distance to primitive `which` at each point, in the world frame.

    Outside, it points away from the nearest surface point; inside, along the axis that leads out
    soonest. Where the gradient does not exist (a sphere's centre, a cylinder's axis) one valid
    direction is returned.
    """
    row = _pick(_rows(primitives), which)
    return jnp.stack(_gradient(_components(points), row), axis=-1)


def signed_distance(
    points: Float[Array, "*points 3"], primitives: Primitives
) -> Float[Array, "*points"]:
    """Signed distance [m] from each point to the union of the primitives; negative inside.

    `FAR` where every primitive is masked. Differentiable in `points` only, by the nearest
    primitive's closed-form normal.
    """
    if primitives.count == 0:
        return jnp.full(points.shape[:-1], FAR, points.dtype)
    return _union(points, _rows(primitives))


@jax.custom_jvp
def _union(points, rows):
    point = _components(points)

    def visit(least, row):
        distance = _distance(point, row)
        return jnp.where(distance > least, least, distance), None

    # Unrolled, the running minimum stays in registers.
    start = jnp.full(points.shape[:-1], FAR, points.dtype)
    least, _ = jax.lax.scan(visit, start, rows, unroll=True)
    return stored(least)


@_union.defjvp
def _union_jvp(primals, tangents):
    points, rows = primals
    point = _components(points)
    row = _pick(rows, _search(point, rows))
    distance = jnp.minimum(_distance(point, row), FAR)
    slope = sum(a * b for a, b in zip(_gradient(point, row), _components(tangents[0]), strict=True))
    return distance, jnp.where(distance < FAR, slope, 0.0)
