"""Set abstraction against brute force: neighbourhoods point by point, in plain loops."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from drpbench.policies.networks.set_abstraction import (
    ball_query,
    check_neighbourhoods,
    farthest_points,
    gather,
    in_pieces,
    neighbourhoods,
)


def clouds(kind, count, seed=0):
    """Three clouds of one kind and their masks."""
    rng = np.random.default_rng(seed)
    points = rng.uniform(-0.5, 0.5, (3, count, 3))
    mask = np.ones((3, count), bool)
    if kind == "clustered":
        points = rng.normal(0, 0.02, points.shape) + points[:, rng.integers(5, size=count)]
    elif kind == "duplicate":
        points = points[:, rng.integers(20, size=count)]
    elif kind == "masked":
        mask = rng.random(mask.shape) < np.array([[0.5], [0.9], [0.02]])
        mask[:, 0], mask[:, 9] = False, True
        points = np.where(mask[..., None], points, 0.0)
    elif kind == "grid":  # many ties, exact in float32
        points = np.round(8 * points) / 8
    return points.astype(np.float32), mask


def squared_distances(points, center):
    # In float32 and in the order of the code under test, so that ties are the same ties.
    x, y, z = ((points[:, i] - center[i]) ** 2 for i in range(3))
    return (x + y) + z


def slow_farthest(points, mask, count):
    chosen = [int(np.flatnonzero(mask)[0]) if mask.any() else 0]
    while len(chosen) < count:
        gap = np.min([squared_distances(points, points[i]) for i in chosen], axis=0)
        chosen.append(int(np.argmax(np.where(mask, gap, -1.0))))
    return chosen


def slow_ball(points, mask, center, radius, samples):
    near = np.flatnonzero(mask & (squared_distances(points, center) < np.float32(radius**2)))
    if len(near) == 0:
        return [0] * samples
    return [*near[:samples], *([near[0]] * (samples - len(near[:samples])))]


KINDS = ("random", "clustered", "duplicate", "masked", "grid")
CASES = [*((kind, 100) for kind in KINDS), ("random", 64), ("clustered", 512), ("masked", 512)]


@pytest.mark.parametrize(("kind", "count"), CASES)
def test_farthest_points_are_those_of_brute_force(kind, count):
    points, mask = clouds(kind, count)
    found = np.asarray(jax.jit(farthest_points, static_argnums=2)(points, mask, 24))
    for i in range(3):
        assert found[i].tolist() == slow_farthest(points[i], mask[i], 24)
        assert mask[i][found[i]].all()


@pytest.mark.parametrize(("kind", "count"), CASES)
@pytest.mark.parametrize(("radius", "samples"), [(0.15, 16), (0.4, 64), (1e-3, 8)])
def test_neighbours_are_those_of_brute_force(kind, count, radius, samples):
    points, mask = clouds(kind, count)
    rng = np.random.default_rng(1)
    # Centres from the cloud, and some elsewhere: those may have no neighbour at all.
    centers = np.concatenate([points[:, ::10], rng.uniform(-1, 1, (3, 5, 3))], 1).astype(np.float32)
    query = jax.jit(ball_query, static_argnums=(3, 4))
    found = np.asarray(query(points, mask, centers, radius, samples))
    for i in range(3):
        expected = [slow_ball(points[i], mask[i], c, radius, samples) for c in centers[i]]
        np.testing.assert_array_equal(found[i], expected)


@pytest.mark.slow
def test_the_radius_itself_is_outside():
    points = np.float32([[0, 0, 0], [0.5, 0, 0], [0.25, 0, 0]])
    found = ball_query(jnp.asarray(points), jnp.ones(3, bool), jnp.zeros((1, 3)), 0.5, 3)
    assert found.tolist() == [[0, 2, 0]]


@pytest.mark.slow
def test_every_bit_of_a_word_is_found():
    """Alone, each of 70 points is its own neighbour, whichever bit of whichever word it is."""
    points = jnp.arange(70.0)[:, None] * jnp.ones(3)
    found = ball_query(points, jnp.ones(70, bool), points, 0.5, 4)
    np.testing.assert_array_equal(found, np.arange(70)[:, None].repeat(4, 1))
    all_of_them = ball_query(points, jnp.ones(70, bool), points[:1], 1e3, 70)
    np.testing.assert_array_equal(all_of_them[0], np.arange(70))


def test_neighbourhoods_are_relative_and_in_radii():
    points, mask = clouds("masked", 512)
    centers = points[:, :160:10]
    around = jax.jit(neighbourhoods, static_argnums=(3, 4))(points, mask, centers, 0.2, 32)
    for i in range(3):
        for k in range(16):
            near = slow_ball(points[i], mask[i], centers[i, k], 0.2, 32)
            expected = (points[i][near] - centers[i, k]) / 0.2
            np.testing.assert_allclose(around[i, k], expected, atol=1e-6)


@pytest.mark.slow
def test_batched_clouds_are_single_clouds():
    points, mask = map(jnp.asarray, clouds("masked", 100))

    def tokens(points, mask):
        chosen = farthest_points(points, mask, 8)
        return chosen, neighbourhoods(points, mask, gather(points, chosen), 0.2, 16)

    together = tokens(points[:, None], mask[:, None])
    single = jax.vmap(tokens)(points, mask)
    np.testing.assert_array_equal(together[0][:, 0], single[0])
    np.testing.assert_array_equal(together[1][:, 0], single[1])


@pytest.mark.slow
def test_a_cloud_without_points_gives_finite_neighbourhoods():
    points, mask = jnp.zeros((64, 3)), jnp.zeros(64, bool)
    centers = gather(points, farthest_points(points, mask, 8))
    assert np.isfinite(neighbourhoods(points, mask, centers, 0.1, 16)).all()


@pytest.mark.slow
@pytest.mark.parametrize("batch", [1, 6, 7])
@pytest.mark.parametrize("neighbours", [1, 3000, 10**6])
def test_pieces_are_the_whole_and_so_is_their_gradient(batch, neighbours):
    x, y = jax.random.normal(jax.random.key(0), (2, batch, 5, 3))

    def function(x, y):
        return jnp.sin(x @ jnp.swapaxes(y, -1, -2))

    found, pull = jax.vjp(lambda x, y: in_pieces(function, neighbours, x, y), x, y)
    expected, pull_whole = jax.vjp(function, x, y)
    np.testing.assert_allclose(found, expected, atol=1e-6)
    for a, b in zip(pull(found), pull_whole(found), strict=True):
        np.testing.assert_allclose(a, b, atol=1e-5)


def test_this_machine_finds_the_right_neighbourhoods():
    assert check_neighbourhoods() is None


def _nearest_instead_of_first(points, mask, centers, radius, samples):
    away = jnp.linalg.norm(points[..., None, :, :] - centers[..., None, :], axis=-1)
    away = jnp.where(mask[..., None, :] & (away < radius), away, jnp.inf)
    order = jnp.argsort(away, axis=-1)[..., :samples]
    return jnp.where(jnp.take_along_axis(away, order, -1) < radius, order, order[..., :1])


WRONG = {
    "nearest instead of first": ("ball_query", _nearest_instead_of_first),
    "zeros, as an unbuilt kernel returns": (
        "ball_query",
        lambda points, mask, centers, radius, samples: jnp.zeros(
            (*centers.shape[:-1], samples), jnp.int32
        ),
    ),
    "masked points too": (
        "ball_query",
        lambda points, mask, *rest: ball_query(points, jnp.ones_like(mask), *rest),
    ),
    "padded with index 0": (
        "ball_query",
        lambda points, mask, centers, radius, samples: jnp.where(
            jnp.arange(samples) == 0,
            ball_query(points, mask, centers, radius, samples),
            jnp.where(
                jnp.diff(ball_query(points, mask, centers, radius, samples), prepend=-1, axis=-1)
                > 0,
                ball_query(points, mask, centers, radius, samples),
                0,
            ),
        ),
    ),
    "the radius squared twice": (
        "ball_query",
        lambda points, mask, centers, radius, samples: ball_query(
            points, mask, centers, radius**2, samples
        ),
    ),
    "the first points instead of the farthest": (
        "farthest_points",
        lambda points, mask, count: jnp.broadcast_to(
            jnp.arange(count), (*points.shape[:-2], count)
        ),
    ),
}


@pytest.mark.parametrize("fault", WRONG)
def test_a_wrong_neighbourhood_is_noticed(fault, monkeypatch):
    name, wrong = WRONG[fault]
    monkeypatch.setattr(f"drpbench.policies.networks.set_abstraction.{name}", wrong)
    said = check_neighbourhoods()
    assert said and "\n" not in said
    assert ("farthest" in said) == (name == "farthest_points")
