"""The cover's figures on a solid whose answers are known in closed form."""

import numpy as np
import pytest
import trimesh

from drpbench.robot.link_meshes import LinkMesh, winding_number
from drpbench.robot.sphere_cover import exposed_points, farthest_points, gap, measure_cover

SIDE = 0.1


def box(low, high):
    return trimesh.creation.box(bounds=[low, high])


@pytest.fixture(scope="module")
def cube():
    return LinkMesh.of_parts("cube", [box([-SIDE / 2] * 3, [SIDE / 2] * 3)])


def test_one_sphere_in_a_cube_leaves_its_corners_and_bulges_at_its_faces(cube):
    radius = 0.06
    figures = measure_cover(cube, np.array([[0.0, 0.0, 0.0, radius]]), 20_000, seed=0)
    assert figures.largest_gap == pytest.approx(np.sqrt(3) * SIDE / 2 - radius, abs=1e-9)
    assert figures.max_excess == pytest.approx(radius - SIDE / 2, abs=1e-4)
    assert figures.exposed_area == pytest.approx(4 * np.pi * radius**2, rel=1e-9)
    # Six caps of height h = radius - half a side stand out; a sphere's area is uniform along an
    # axis, so each cap has the mean excess h / 2 over the share h / (2 radius) of the surface.
    h = radius - SIDE / 2
    assert figures.mean_excess == pytest.approx(6 * h / (2 * radius) * h / 2, rel=0.03)


def test_what_another_sphere_hides_is_not_exposed():
    spheres = np.array([[0.0, 0.0, 0.0, 0.05], [0.01, 0.0, 0.0, 0.02]])
    points, area = exposed_points(spheres, 5000, np.random.default_rng(0))
    np.testing.assert_allclose(np.linalg.norm(points, axis=1), 0.05)
    assert area == pytest.approx(4 * np.pi * 0.05**2, rel=0.02)


def test_gap_is_signed():
    spheres = np.array([[0.0, 0.0, 0.0, 0.05]])
    np.testing.assert_allclose(
        gap(spheres, np.array([[0.08, 0.0, 0.0], [0.0, 0.02, 0.0]])), [0.03, -0.03]
    )


def test_signed_distance_of_a_cube(cube):
    points = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 0.045], [0.08, 0.0, 0.0], [0.08, 0.09, 0.05]])
    expected = [-0.05, -0.005, 0.03, 0.05]
    np.testing.assert_allclose(cube.signed_distance(points), expected, atol=1e-9)


def test_the_surface_of_overlapping_parts_is_the_outer_one():
    # A box of 0.2 x 0.1 x 0.1, and a thinner one that runs from its middle to 0.1 beyond its end.
    first, second = ([0, 0, 0], [0.2, 0.1, 0.1]), ([0.1, 0.02, 0.02], [0.3, 0.08, 0.08])
    pair = LinkMesh.of_parts("pair", [box(*first), box(*second)])
    points = pair.sample_surface(3000, np.random.default_rng(0))
    for low, high in (first, second):
        assert not np.all((points > np.add(low, 1e-6)) & (points < np.add(high, -1e-6)), 1).any()
    assert pair.outer_area() == pytest.approx(0.1 + 4 * 0.06 * 0.1, rel=0.01)
    # The second box's hidden end is no surface: from its middle the first's side is nearest.
    assert pair.signed_distance(np.array([[0.1, 0.05, 0.05]]))[0] == pytest.approx(-0.05, abs=1e-6)


def test_winding_number_tells_inside_from_outside(cube):
    points = np.array([[0.0, 0.01, 0.02], [0.06, 0.0, 0.0]])
    np.testing.assert_allclose(winding_number(cube.triangles, points), [1.0, 0.0], atol=1e-9)


def test_farthest_points_spread_and_refuse_too_many():
    grid = np.stack(np.meshgrid(*[np.arange(5.0)] * 2), axis=-1).reshape(-1, 2)
    corners = grid[farthest_points(grid, 4)]
    assert {tuple(p) for p in corners} == {(0, 0), (0, 4), (4, 0), (4, 4)}
    with pytest.raises(ValueError, match="26 of 25"):
        farthest_points(grid, 26)
