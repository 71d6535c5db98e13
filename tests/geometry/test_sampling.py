"""Points on surfaces: where they lie, how many on each, and how they spread."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import chi2, kstest

from drpbench.compile import jit
from drpbench.geometry import (
    BOX,
    CYLINDER,
    SHAPES,
    SPHERE,
    Primitives,
    areas,
    sample_surface,
    signed_distance,
)

MANY = 50_000


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


_drawn = jit(
    lambda seed, prims, count: sample_surface(jax.random.key(seed), prims, count),
    static_argnums=2,
)


def draw(prims, count=MANY, seed=0):
    """Points (count, 3) and the index of each one's primitive, as numpy arrays."""
    return map(np.asarray, _drawn(seed, prims, count))


def assert_shares(counts, expected):
    """Counts that a chi-square test would reject only once in 10,000 (seeds are fixed)."""
    counts, expected = np.asarray(counts, float), np.asarray(expected, float)
    expected = expected / expected.sum() * counts.sum()
    statistic = np.sum((counts - expected) ** 2 / expected)
    assert statistic < chi2.ppf(1.0 - 1e-4, len(counts) - 1), (counts, expected)


HALF = {BOX: (0.3, 0.2, 0.05), CYLINDER: (0.2, 0.2, 0.15), SPHERE: (0.25, 0.25, 0.25)}


@pytest.mark.parametrize("kind", [BOX, CYLINDER, SPHERE], ids=SHAPES)
def test_points_lie_on_the_surface(kind):
    rotation = Rotation.random(rng=np.random.default_rng(0)).as_matrix()
    prims = primitives([kind], [HALF[kind]], [[0.4, -0.3, 0.6]], rotation[None])
    points, which = draw(prims, 5_000)
    assert np.all(which == 0)
    distance = jit(signed_distance)(points, prims)
    assert np.abs(distance).max() < 1e-5


def test_each_point_lies_on_the_primitive_it_names():
    rng = np.random.default_rng(1)
    kind = np.array([BOX, CYLINDER, SPHERE, BOX, SPHERE])
    rotation = Rotation.random(5, rng=rng).as_matrix()
    prims = primitives(kind, [HALF[k] for k in kind], rng.uniform(-1, 1, (5, 3)), rotation)
    points, which = draw(prims, 5_000)
    for k in range(5):
        alone = jax.tree.map(lambda field, k=k: field[k : k + 1], prims)
        assert np.abs(jit(signed_distance)(points[which == k], alone)).max() < 1e-5


def test_areas_are_the_textbooks():
    prims = primitives(
        [BOX, CYLINDER, SPHERE, SPHERE],
        [HALF[BOX], HALF[CYLINDER], HALF[SPHERE], HALF[SPHERE]],
        mask=[True, True, True, False],
    )
    expected = [
        [2 * 0.4 * 0.1, 2 * 0.6 * 0.1, 2 * 0.6 * 0.4],
        [2 * np.pi * 0.2**2, 2 * np.pi * 0.2 * 0.3, 0.0],
        [4 * np.pi * 0.25**2, 0.0, 0.0],
        [0.0, 0.0, 0.0],
    ]
    np.testing.assert_allclose(areas(jax.tree.map(jnp.asarray, prims)), expected, rtol=1e-6)


def test_primitives_get_points_by_their_area():
    rng = np.random.default_rng(2)
    kind = rng.integers(0, 3, 12)
    sizes = rng.uniform(0.02, 0.3, (12, 3))
    sizes[kind != BOX, 1] = sizes[kind != BOX, 0]
    sizes[kind == SPHERE, 2] = sizes[kind == SPHERE, 0]
    prims = primitives(kind, sizes)
    _, which = draw(prims)
    area = np.asarray(areas(jax.tree.map(jnp.asarray, prims))).sum(axis=1)
    assert_shares(np.bincount(which, minlength=12), area)


def test_a_box_gets_points_by_the_area_of_its_faces_evenly():
    half = np.array(HALF[BOX])
    points, _ = draw(primitives([BOX], [half]))
    scaled = points / half
    face = np.argmax(np.abs(scaled), axis=1) * 2 + (
        np.take_along_axis(scaled, np.argmax(np.abs(scaled), axis=1)[:, None], axis=1)[:, 0] > 0
    )
    per_axis = np.array([half[1] * half[2], half[0] * half[2], half[0] * half[1]])
    assert_shares(np.bincount(face, minlength=6), np.repeat(per_axis, 2))
    for axis in range(3):
        on_face = scaled[face // 2 == axis]
        np.testing.assert_allclose(np.abs(on_face[:, axis]), 1.0, atol=1e-5)
        first, second = (on_face[:, i] for i in range(3) if i != axis)
        # A 5 x 5 grid over the faces: even, and the two coordinates independent.
        cells, *_ = np.histogram2d(first, second, bins=5, range=[[-1, 1], [-1, 1]])
        assert_shares(cells.ravel(), np.ones(25))


def test_a_cylinder_gets_points_on_caps_and_side_evenly():
    radius, _, height = HALF[CYLINDER]
    points, _ = draw(primitives([CYLINDER], [HALF[CYLINDER]]))
    rho, z = np.hypot(points[:, 0], points[:, 1]), points[:, 2]
    angle = np.arctan2(points[:, 1], points[:, 0])
    top, bottom = z > height - 1e-6, z < -height + 1e-6
    side = ~top & ~bottom
    np.testing.assert_allclose(rho[side], radius, atol=1e-6)
    cap, mantle = np.pi * radius**2, 2 * np.pi * radius * 2 * height
    assert_shares([top.sum(), bottom.sum(), side.sum()], [cap, cap, mantle])
    # Even over a disc: the square of the radius is uniform. Even over the side: height and angle
    # are.
    for part, coordinate in ((top, (rho / radius) ** 2), (bottom, (rho / radius) ** 2)):
        assert kstest(coordinate[part], "uniform").pvalue > 1e-4
    assert kstest(z[side] / (2 * height) + 0.5, "uniform").pvalue > 1e-4
    for part in (top, bottom, side):
        assert kstest(angle[part] / (2 * np.pi) + 0.5, "uniform").pvalue > 1e-4
    cells, *_ = np.histogram2d(
        angle[side], z[side], bins=6, range=[[-np.pi, np.pi], [-height, height]]
    )
    assert_shares(cells.ravel(), np.ones(36))


def test_a_sphere_gets_points_evenly_over_every_axis():
    points, _ = draw(primitives([SPHERE], [HALF[SPHERE]]))
    unit = points / HALF[SPHERE][0]
    for axis in np.vstack([np.eye(3), [0.6, 0.0, 0.8]]):
        # Archimedes: the height over any plane through the centre is uniform.
        assert kstest((unit @ axis + 1.0) / 2.0, "uniform").pvalue > 1e-4
    octant = (unit > 0.0) @ np.array([1, 2, 4])
    assert_shares(np.bincount(octant, minlength=8), np.ones(8))


def test_masked_primitives_get_no_point():
    rng = np.random.default_rng(3)
    count = 64
    mask = rng.random(count) < 0.5
    prims = primitives(
        np.full(count, SPHERE), np.repeat(rng.uniform(0.01, 0.5, (count, 1)), 3, axis=1), mask=mask
    )
    _, which = draw(prims)
    assert np.all(mask[which])
    assert set(which) == set(np.flatnonzero(mask))


def test_what_has_no_area_takes_no_share_of_the_draw():
    # A running sum in float32, in whatever order, may grow or shrink by rounding where nothing was
    # added; each share must be exactly empty there.
    from drpbench.geometry.sampling import _upper_ends

    rng = np.random.default_rng(4)
    for count in (3, 72, 300, 3000):
        area = rng.uniform(0.001, 1.0, count).astype(np.float32)
        area[rng.random(count) < 0.5] = 0.0
        area[0] = 1.0
        ends = np.asarray(jit(_upper_ends)(area))
        share = np.diff(ends, prepend=np.float32(0.0))
        assert np.all(share[area == 0.0] == 0.0)
        np.testing.assert_allclose(share, area, atol=1e-3)
        np.testing.assert_allclose(ends[-1], area.sum(dtype=float), rtol=1e-5)


@pytest.mark.parametrize("count", [0, 3])
def test_without_any_primitive_points_are_at_the_origin(count):
    prims = primitives(
        np.zeros(count), np.full((count, 3), 0.1), np.ones((count, 3)), mask=np.zeros(count)
    )
    points, which = draw(prims, 5)
    np.testing.assert_array_equal(points, np.zeros((5, 3)))
    np.testing.assert_array_equal(which, 0)


def test_flat_and_empty_shapes_give_finite_points():
    # A plate without thickness has two faces; a ball without radius has no surface.
    prims = primitives([BOX, SPHERE], [[0.1, 0.2, 0.0], [0.0, 0.0, 0.0]])
    points, which = draw(prims, 1_000)
    assert np.all(which == 0) and np.all(points[:, 2] == 0.0)
    assert np.ptp(points[:, 0]) > 0.19 and np.ptp(points[:, 1]) > 0.38


def test_the_key_decides_the_points():
    prims = primitives([BOX], [HALF[BOX]])
    first, again, other = (next(draw(prims, 10, seed)) for seed in (1, 1, 2))
    np.testing.assert_array_equal(first, again)
    assert np.abs(first - other).max() > 0.01
