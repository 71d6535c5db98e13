"""The signed distance against closed forms in float64, against C MuJoCo, and its gradient."""

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from drpbench.compile import jit
from drpbench.geometry import (
    BOX,
    CYLINDER,
    FAR,
    SHAPES,
    SPHERE,
    Primitives,
    nearest,
    normal,
    signed_distance,
)

TOLERANCE = 1e-4  # [m], what is promised
ROUNDING = 4e-6  # [m], what float32 leaves of it within 2 m of the origin
POINTS = 8  # points at a time, so that one compiled function serves every example


def primitives(kind, half_size, position=None, rotation=None, mask=None):
    """float32 primitives; by default at the origin, unrotated, unmasked."""
    shape = np.shape(kind)
    position = np.zeros((*shape, 3)) if position is None else position
    rotation = np.broadcast_to(np.eye(3), (*shape, 3, 3)) if rotation is None else rotation
    return Primitives(
        kind=np.asarray(kind, np.int32),
        half_size=np.asarray(half_size, np.float32),
        position=np.asarray(position, np.float32),
        rotation=np.asarray(rotation, np.float32),
        mask=np.ones(shape, bool) if mask is None else np.asarray(mask, bool),
    )


def half_size(kind, a, b, c):
    """`half_size` of one primitive from three free sizes."""
    return {BOX: (a, b, c), CYLINDER: (a, a, c), SPHERE: (a, a, a)}[kind]


def scene(rng, count, mask=None):
    """Primitives of mixed kinds in random poses within 0.6 m, 1 mm to 0.5 m big."""
    kind = rng.integers(0, 3, count)
    sizes = np.exp(rng.uniform(np.log(5e-4), np.log(0.25), (count, 3)))
    halves = [half_size(k, *s) for k, s in zip(kind, sizes, strict=True)]
    rotation = Rotation.random(count, rng=rng).as_matrix()
    position = rng.uniform(-0.6, 0.6, (count, 3))
    return primitives(kind, np.reshape(halves, (count, 3)), position, rotation, mask)


def in_frame(point, prims, k):
    """A world point (3,) in the frame of primitive k, in float64."""
    return (np.asarray(point, float) - prims.position[k]) @ prims.rotation[k].astype(float)


def in_world(point, prims, k):
    """The inverse of `in_frame`, as the float32 point that JAX sees."""
    return (prims.rotation[k].astype(float) @ point + prims.position[k]).astype(np.float32)


def closed_form(kind, half, p):
    """Signed distance [m] of `p` (3,) in the primitive's frame.

    Outside, the distance to the nearest point of the solid; inside, minus the shortest way out.
    """
    half = np.asarray(half, float)
    if kind == BOX:
        outside = np.linalg.norm(p - np.clip(p, -half, half))
        return outside if outside > 0.0 else -np.min(half - np.abs(p))
    if kind == CYLINDER:
        radius, height = half[0], half[2]
        rho = np.hypot(p[0], p[1])
        if rho <= radius and abs(p[2]) <= height:
            return -min(radius - rho, height - abs(p[2]))
        return np.hypot(rho - min(rho, radius), p[2] - np.clip(p[2], -height, height))
    return np.linalg.norm(p) - half[0]


def expected(point, prims, k):
    """Signed distance [m] of one world point to primitive k, its mask ignored."""
    return closed_form(prims.kind[k], prims.half_size[k], in_frame(point, prims, k))


def table(points, prims):
    """Signed distances (N, K) of points (N, 3), masks ignored."""
    return np.array([[expected(p, prims, k) for k in range(prims.count)] for p in points])


distance_of = jit(signed_distance)
nearest_of = jit(nearest)
normal_of = jit(normal)


# One primitive, everywhere about it.


@st.composite
def encounters(draw):
    """One primitive and POINTS points: deep inside, in contact, close by, far off, on its
    symmetries."""
    kind = draw(st.sampled_from([BOX, CYLINDER, SPHERE]))
    # 0.5 mm to 0.5 m each, so that plates, rods and specks all come up.
    sizes = [5e-4 * 10.0 ** draw(st.floats(0.0, 3.0)) for _ in range(3)]
    quaternion = np.array([draw(st.floats(-1.0, 1.0)) for _ in range(4)])
    if np.linalg.norm(quaternion) < 0.1:
        quaternion = np.array([1.0, 0.0, 0.0, 0.0])
    position = [draw(st.floats(-1.0, 1.0)) for _ in range(3)]
    rotation = Rotation.from_quat(quaternion, scalar_first=True).as_matrix()
    prims = primitives([kind], [half_size(kind, *sizes)], [position], rotation[None])
    scaled = st.one_of(st.sampled_from([0.0, -1.0, 1.0]), st.floats(-2.5, 2.5))
    nudge = st.one_of(st.just(0.0), st.floats(-1e-4, 1e-4), st.floats(-0.5, 0.5))
    points = np.empty((POINTS, 3), np.float32)
    for i in range(POINTS):
        local = [draw(scaled) * half + draw(nudge) for half in prims.half_size[0].tolist()]
        points[i] = in_world(np.array(local), prims, 0)
    return points, prims


@settings(max_examples=150, deadline=None, derandomize=True)
@given(encounters())
def test_distance_is_the_closed_form(encounter):
    points, prims = encounter
    exact = table(points, prims)[:, 0]
    np.testing.assert_allclose(distance_of(points, prims), exact, atol=ROUNDING)
    distance, which = nearest_of(points, prims)
    np.testing.assert_allclose(distance, exact, atol=ROUNDING)
    assert not np.any(which)


def mujoco_distance(point, prims, k, radius=1e-4):
    """Signed distance [m] by `mj_geomDistance`, from a small sphere about the point.

    In MuJoCo 4.0 it holds inside as well as outside, for spheres against these three.
    """
    half = prims.half_size[k].astype(float)
    size = {BOX: half, CYLINDER: half[[0, 2]], SPHERE: half[:1]}[int(prims.kind[k])]
    shape, size = SHAPES[prims.kind[k]], " ".join(map(repr, size.tolist()))
    model = mujoco.MjModel.from_xml_string(f"""
        <mujoco><worldbody>
          <geom type="sphere" size="{radius}"/> <geom type="{shape}" size="{size}"/>
        </worldbody></mujoco>""")
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    data.geom_xpos[:] = point, prims.position[k]
    data.geom_xmat[1] = prims.rotation[k].ravel()
    return mujoco.mj_geomDistance(model, data, 0, 1, 10.0, None) + radius


@settings(max_examples=100, deadline=None, derandomize=True)
@given(encounters())
def test_distance_is_mujocos(encounter):
    points, prims = encounter
    exact = [mujoco_distance(point, prims, 0) for point in points]
    np.testing.assert_allclose(distance_of(points, prims), exact, atol=TOLERANCE)


@settings(max_examples=150, deadline=None, derandomize=True)
@given(encounters())
def test_normal_is_a_unit_vector_that_leads_to_the_surface(encounter):
    points, prims = encounter
    distance, which = nearest_of(points, prims)
    direction = np.asarray(normal_of(points, prims, which))
    assert np.all(np.isfinite(direction))
    np.testing.assert_allclose(np.linalg.norm(direction, axis=-1), 1.0, atol=1e-5)
    foot = points - np.asarray(distance)[:, None] * direction
    np.testing.assert_allclose(table(foot, prims)[:, 0], 0.0, atol=2 * ROUNDING)


EXTREMES = {
    "plate of 1 mm": (BOX, (0.5, 0.4, 0.0005)),
    "speck": (SPHERE, (0.0005, 0.0005, 0.0005)),
    "long rod": (CYLINDER, (0.002, 0.002, 1.0)),
    "coin": (CYLINDER, (0.3, 0.3, 0.0005)),
    "needle": (BOX, (0.0005, 0.0005, 0.5)),
    "large ball": (SPHERE, (1.5, 1.5, 1.5)),
}


@pytest.mark.parametrize(("kind", "half"), EXTREMES.values(), ids=EXTREMES)
def test_extreme_sizes(kind, half):
    rng = np.random.default_rng(0)
    prims = primitives([kind], [half], [[0.3, -0.2, 0.5]], Rotation.random(1, rng=rng).as_matrix())
    around = rng.uniform(-1.5, 1.5, (300, 3))
    close = rng.uniform(-1.0, 1.0, (700, 3)) * half + rng.normal(0.0, 5e-4, (700, 3))
    points = np.stack([in_world(p, prims, 0) for p in np.concatenate([around, close])])
    exact = table(points, prims)[:, 0]
    assert (exact < 0.0).sum() > 10 and (exact > 0.0).sum() > 10
    np.testing.assert_allclose(distance_of(points, prims), exact, atol=ROUNDING)
    from_mujoco = [mujoco_distance(point, prims, 0) for point in points[::10]]
    np.testing.assert_allclose(distance_of(points, prims)[::10], from_mujoco, atol=TOLERANCE)


def differences(point, prims, k, step=1e-5):
    """Forward and backward difference quotients (2, 3) of the closed form at a world point."""
    middle = expected(point, prims, k)
    ahead = [expected(point + step * axis, prims, k) - middle for axis in np.eye(3)]
    behind = [middle - expected(point - step * axis, prims, k) for axis in np.eye(3)]
    return np.array([ahead, behind]) / step


@pytest.mark.parametrize("kind", [BOX, CYLINDER, SPHERE], ids=SHAPES)
def test_normal_is_the_gradient(kind):
    rng = np.random.default_rng(1)
    count = 1200
    sizes = rng.uniform(0.02, 0.3, (count, 3))
    prims = primitives(
        np.full(count, kind),
        [half_size(kind, *s) for s in sizes],
        rng.uniform(-0.5, 0.5, (count, 3)),
        Rotation.random(count, rng=rng).as_matrix(),
    )
    local = rng.uniform(-2.0, 2.0, (count, 3)) * prims.half_size
    points = np.stack([in_world(p, prims, k) for k, p in enumerate(local)])
    which = np.arange(count, dtype=np.int32)
    found = np.asarray(normal_of(points, prims, which))
    inside = smooth = 0
    for k, point in enumerate(points.astype(float)):
        ahead, behind = differences(point, prims, k)
        if np.abs(ahead - behind).max() > 0.01:
            continue  # at an edge, or on the medial axis
        smooth += 1
        inside += expected(point, prims, k) < 0.0
        np.testing.assert_allclose(found[k], (ahead + behind) / 2.0, atol=2e-3)
    assert smooth > 0.95 * count and inside > 50


@pytest.mark.parametrize("kind", [BOX, CYLINDER, SPHERE], ids=SHAPES)
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_normal_at_every_centre_axis_face_edge_and_corner(kind, sign):
    half = np.array(half_size(kind, 0.25, 0.125, 0.5))
    prims = primitives([kind], [half])
    steps = np.array([0.0, 0.25, 1.0, 1.5])
    grid = sign * half * np.stack(np.meshgrid(steps, steps, steps), axis=-1).reshape(-1, 3)
    points = grid.astype(np.float32)  # with -0.0 among them
    distance, which = nearest_of(points, prims)
    direction = np.asarray(normal_of(points, prims, which))
    np.testing.assert_allclose(np.linalg.norm(direction, axis=-1), 1.0, atol=1e-6)
    foot = points - np.asarray(distance)[:, None] * direction
    np.testing.assert_allclose(table(foot, prims)[:, 0], 0.0, atol=1e-6)


def test_normal_is_a_unit_vector_a_hair_outside_a_tiny_ball():
    prims = primitives([SPHERE], [[1e-7] * 3])
    points = np.float32(1e-7) * np.array([[1.000001, 0.0, 0.0], [0.0, 0.0, -1.000001]], np.float32)
    assert np.all(np.asarray(distance_of(points, prims)) > 0.0)
    direction = normal_of(points, prims, np.zeros(2, np.int32))
    np.testing.assert_allclose(direction, [[1.0, 0.0, 0.0], [0.0, 0.0, -1.0]], atol=1e-6)


# Many primitives, some of them masked.


@pytest.mark.parametrize("count", [1, 2, 3, 8, 33])
def test_union_is_the_minimum_over_the_unmasked(count):
    rng = np.random.default_rng(count)
    mask = rng.random(count) < 0.7
    mask[rng.integers(count)] = True
    prims = scene(rng, count, mask)
    points = rng.uniform(-1.0, 1.0, (200, 3)).astype(np.float32)
    points[:60] += prims.position[rng.choice(np.flatnonzero(mask), 60)] - points[:60]
    each = np.where(mask, table(points, prims), np.inf)
    distance, which = nearest_of(points, prims)
    np.testing.assert_allclose(distance_of(points, prims), each.min(axis=1), atol=ROUNDING)
    np.testing.assert_allclose(distance, each.min(axis=1), atol=ROUNDING)
    assert np.all(mask[which])
    chosen = each[np.arange(len(points)), which]
    np.testing.assert_allclose(chosen, each.min(axis=1), atol=ROUNDING)
    assert len(np.unique(which)) >= min(mask.sum(), 3)


def test_inside_several_the_deepest_counts():
    rng = np.random.default_rng(9)
    kind = np.arange(6) % 3
    halves = [half_size(k, *s) for k, s in zip(kind, rng.uniform(0.3, 0.8, (6, 3)), strict=True)]
    rotation = Rotation.random(6, rng=rng).as_matrix()
    prims = primitives(kind, halves, rng.uniform(-0.1, 0.1, (6, 3)), rotation)
    points = rng.uniform(-0.3, 0.3, (200, 3)).astype(np.float32)
    each = table(points, prims)
    assert np.all((each < 0.0).sum(axis=1) > 1)
    distance, which = nearest_of(points, prims)
    np.testing.assert_allclose(distance, each.min(axis=1), atol=ROUNDING)
    np.testing.assert_allclose(distance_of(points, prims), each.min(axis=1), atol=ROUNDING)
    assert len(np.unique(which)) > 2


def test_of_equal_distances_the_sign_is_never_lost():
    # Twice the same ball, the second one a hair bigger: only for it are the points inside.
    prims = primitives([SPHERE, SPHERE], [[0.1] * 3, [0.1000002] * 3])
    points = np.array([[0.1000001, 0.0, 0.0]], np.float32)
    distance, which = nearest_of(points, prims)
    assert distance[0] < 0.0 and which[0] == 1
    assert distance_of(points, prims)[0] < 0.0


@pytest.mark.parametrize("count", [0, 1, 5])
def test_without_any_primitive_everything_is_far(count):
    prims = scene(np.random.default_rng(2), count, mask=np.zeros(count, bool))
    points = jnp.asarray(np.random.default_rng(3).uniform(-1.0, 1.0, (4, 3)), jnp.float32)
    distance, which = nearest_of(points, prims)
    np.testing.assert_array_equal(distance, np.float32(FAR))
    np.testing.assert_array_equal(which, 0)
    np.testing.assert_array_equal(distance_of(points, prims), np.float32(FAR))
    slope = jit(jax.grad(lambda p: signed_distance(p, prims).sum()))(points)
    np.testing.assert_array_equal(slope, 0.0)


def test_points_may_have_any_batch_axes():
    rng = np.random.default_rng(4)
    prims = scene(rng, 6)
    points = rng.uniform(-1.0, 1.0, (2, 3, 4, 3)).astype(np.float32)
    flat = distance_of(points.reshape(-1, 3), prims)
    np.testing.assert_allclose(distance_of(points, prims), flat.reshape(2, 3, 4), atol=1e-6)
    distance, which = nearest_of(points, prims)
    assert distance.shape == which.shape == (2, 3, 4)
    assert normal_of(points, prims, which).shape == points.shape
    assert distance_of(points[0, 0, 0], prims).shape == ()


def test_a_point_that_is_not_a_number_has_no_distance():
    prims = scene(np.random.default_rng(5), 4)
    points = np.array([[0.1, np.nan, 0.0], [0.1, 0.2, 0.3]], np.float32)
    for distance in (distance_of(points, prims), nearest_of(points, prims)[0]):
        np.testing.assert_array_equal(np.isnan(distance), [True, False])


# The gradient under JAX's transformations.


@pytest.mark.slow
def test_gradient_is_the_normal_of_the_nearest_under_every_transformation():
    rng = np.random.default_rng(6)
    worlds, count = 5, 7
    prims = [scene(rng, count, rng.random(count) < 0.8) for _ in range(worlds)]
    prims = jax.tree.map(lambda *fields: jnp.stack(fields), *prims)
    points = rng.uniform(-0.8, 0.8, (worlds, 30, 3)).astype(np.float32)
    tangent = rng.normal(size=points.shape).astype(np.float32)

    @jit
    @jax.vmap
    def reference(points, prims):
        distance, which = nearest(points, prims)
        return distance, normal(points, prims, which)

    @jit
    @jax.vmap
    def reverse(points, prims):
        return jax.value_and_grad(lambda p: signed_distance(p, prims).sum())(points)

    @jit
    @jax.vmap
    def forward(points, tangent, prims):
        return jax.jvp(lambda p: signed_distance(p, prims), (points,), (tangent,))

    @jit
    @jax.vmap
    def one_by_one(points, prims):
        return jax.vmap(jax.grad(signed_distance), in_axes=(0, None))(points, prims)

    distance, direction = reference(points, prims)
    total, slope = reverse(points, prims)
    np.testing.assert_allclose(total, distance.sum(axis=1), rtol=1e-5)
    np.testing.assert_allclose(slope, direction, atol=1e-6)
    np.testing.assert_allclose(one_by_one(points, prims), direction, atol=1e-6)
    value, rate = forward(points, tangent, prims)
    np.testing.assert_allclose(value, distance, atol=1e-6)
    np.testing.assert_allclose(rate, jnp.sum(direction * tangent, axis=-1), atol=1e-5)


def test_gradient_survives_a_later_scalar_function():
    # As in a penalty: d/dp of the sum of min(d, 0)^2 is 2 min(d, 0) n.
    rng = np.random.default_rng(7)
    prims = primitives([BOX, SPHERE], [[0.3, 0.3, 0.3], [0.4] * 3], [[0.0, 0.0, 0.0], [0.5, 0, 0]])
    points = rng.uniform(-0.6, 0.6, (40, 3)).astype(np.float32)

    @jit
    def slope(points):
        return jax.grad(lambda p: jnp.sum(jnp.minimum(signed_distance(p, prims), 0.0) ** 2))(points)

    distance, which = nearest_of(points, prims)
    assert 5 < (np.asarray(distance) < 0.0).sum() < 35
    depth = np.minimum(distance, 0.0)[:, None]
    np.testing.assert_allclose(
        slope(points), 2.0 * depth * normal_of(points, prims, which), atol=1e-6
    )


def test_without_the_compiler_options_the_distance_is_the_same():
    rng = np.random.default_rng(8)
    prims = scene(rng, 12)
    points = jnp.asarray(rng.uniform(-1.0, 1.0, (50, 3)), jnp.float32)
    np.testing.assert_allclose(
        jax.jit(signed_distance)(points, prims), distance_of(points, prims), atol=1e-6
    )
    np.testing.assert_allclose(
        signed_distance(points, prims), distance_of(points, prims), atol=1e-6
    )
