"""Points drawn uniformly from the surfaces of primitives."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int, PRNGKeyArray

from .primitives import BOX, CYLINDER, Primitives


def areas(primitives: Primitives) -> Float[Array, " K 3"]:
    """Surface area [m^2] of each primitive, by part; zero where masked.

    Parts: a box's pairs of faces normal to x, y, z; a cylinder's caps and its side (then zero); a
    sphere's whole surface (then zeros).
    """
    a, b, c = (2.0 * primitives.half_size[..., i] for i in range(3))
    radius = primitives.half_size[..., 0]
    zero = jnp.zeros_like(radius)
    box = jnp.stack([2 * b * c, 2 * a * c, 2 * a * b], axis=-1)
    cylinder = jnp.stack([2 * jnp.pi * radius**2, 2 * jnp.pi * radius * c, zero], axis=-1)
    sphere = jnp.stack([4 * jnp.pi * radius**2, zero, zero], axis=-1)
    kind = primitives.kind[..., None]
    area = jnp.where(kind == BOX, box, jnp.where(kind == CYLINDER, cylinder, sphere))
    return jnp.where(primitives.mask[..., None], area, 0.0)


def _upper_ends(area: Float[Array, " P"]) -> Float[Array, " P"]:
    """Where each part's share of the total area ends, the shares laid end to end.

    Rounding, which depends on the order of summation, must give no share to a part without area.
    """
    return jax.lax.cummax(jnp.where(area > 0.0, jnp.cumsum(area), 0.0))


def sample_surface(
    key: PRNGKeyArray,
    primitives: Primitives,
    count: int,
    density: Float[Array, " K"] | None = None,
) -> tuple[Float[Array, "{count} 3"], Int[Array, " {count}"]]:
    """`count` points [m, world frame], uniform over all surfaces, and the primitive each lies on.

    Surfaces inside another primitive are sampled too. Without any primitive, points at the origin.
    `density` makes the points of each primitive so many times as dense.
    """
    if primitives.count == 0:
        return jnp.zeros((count, 3)), jnp.zeros(count, jnp.int32)
    primitives = jax.tree.map(jnp.asarray, primitives)
    pick, place = jax.random.split(key)
    area = areas(primitives) if density is None else areas(primitives) * density[:, None]
    ends = _upper_ends(area.reshape(-1))
    ticket = jax.random.uniform(pick, (count,)) * ends[-1]
    chosen = jnp.minimum(jnp.searchsorted(ends, ticket, side="right"), ends.size - 1)
    which, part = chosen // 3, chosen % 3

    kind = primitives.kind[which]
    half = primitives.half_size[which]
    u, v, w = jax.random.uniform(place, (3, count), minval=-1.0, maxval=1.0)
    side = jnp.where(w < 0.0, -1.0, 1.0)

    # Box: +-1 along the part's axis, uniform along the two others.
    axis = part[:, None] == jnp.arange(3)
    free = jnp.stack([u, v, jnp.where(part == 0, u, v)], axis=-1)
    free = jnp.where((part == 1)[:, None], jnp.stack([u, u, v], axis=-1), free)
    on_box = jnp.where(axis, side[:, None], free) * half
    # Cylinder: caps by a disc's radius law, the side by angle and height.
    angle = jnp.pi * u
    ring = jnp.where(part == 0, jnp.sqrt(jnp.abs(v)), 1.0) * half[:, 0]
    height = jnp.where(part == 0, side, v) * half[:, 2]
    on_cylinder = jnp.stack([ring * jnp.cos(angle), ring * jnp.sin(angle), height], axis=-1)
    # Sphere: z is uniform (Archimedes).
    rim = jnp.sqrt(jnp.maximum(1.0 - v * v, 0.0))
    on_sphere = jnp.stack([rim * jnp.cos(angle), rim * jnp.sin(angle), v], axis=-1) * half[:, :1]

    kind = kind[:, None]
    local = jnp.where(kind == BOX, on_box, jnp.where(kind == CYLINDER, on_cylinder, on_sphere))
    rotated = jnp.einsum("nij,nj->ni", primitives.rotation[which], local, precision="highest")
    points = rotated + primitives.position[which]
    any_surface = ends[-1] > 0.0
    return jnp.where(any_surface, points, 0.0), jnp.where(any_surface, which, 0).astype(jnp.int32)
