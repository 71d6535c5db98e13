"""The shipped collision spheres and surface points, held to the real meshes."""

import json
from pathlib import Path

import numpy as np
import pytest

import drpbench.robot
from drpbench.robot import PANDA
from drpbench.robot.link_meshes import load_link_meshes
from drpbench.robot.sphere_cover import link_spheres, measure_cover, pooled_mean_excess

ROBOT = Path(drpbench.robot.__file__).parent / "arms" / "panda"
ARM, HAND = PANDA.link_names[1:8], PANDA.link_names[8:]


@pytest.fixture(scope="module")
def surface():
    rows = json.loads((ROBOT / "surface.json").read_text())
    return {name: np.array(points) for name, points in rows.items()}


@pytest.fixture(scope="module")
def meshes():
    path = PANDA.meshes.find()
    if path is None:
        pytest.skip(PANDA.meshes.absent)
    return load_link_meshes(path)


@pytest.fixture(scope="module")
def figures(meshes):
    # The right finger has the left one's mesh and the left one's spheres: other tests say so.
    measured = {
        name: measure_cover(meshes[name], link_spheres(PANDA, name), 20_000, seed=7)
        for name in PANDA.link_names
        if name != "right_finger"
    }
    return measured | {"right_finger": measured["left_finger"]}


def test_spheres_are_listed_for_every_link_in_order():
    rows = json.loads((ROBOT / "spheres.json").read_text())
    assert tuple(rows) == PANDA.link_names
    for spheres in rows.values():
        spheres = np.array(spheres)
        assert spheres.ndim == 2 and spheres.shape[1] == 4
        assert np.isfinite(spheres).all() and (spheres[:, 3] > 0).all()


def test_the_moving_links_have_at_most_a_hundred_spheres():
    assert sum(len(link_spheres(PANDA, name)) for name in PANDA.link_names[1:]) <= 100


def test_both_fingers_share_one_sphere_set(meshes):
    np.testing.assert_array_equal(
        link_spheres(PANDA, "left_finger"), link_spheres(PANDA, "right_finger")
    )
    np.testing.assert_allclose(
        meshes["left_finger"].triangles, meshes["right_finger"].triangles, atol=1e-9
    )


@pytest.mark.parametrize("link", PANDA.link_names)
def test_no_mesh_point_is_more_than_3_mm_outside_the_spheres(figures, link):
    assert figures[link].largest_gap <= 0.003


@pytest.mark.parametrize(
    ("links", "mean", "largest"), [(ARM, 0.008, 0.0175), (HAND, 0.003, 0.0065)]
)
def test_spheres_stand_out_little(figures, links, mean, largest):
    assert pooled_mean_excess([figures[name] for name in links]) < mean
    assert max(figures[name].max_excess for name in links) < largest


def test_surface_points_number_512_on_the_moving_links(surface):
    assert tuple(surface) == PANDA.link_names[1:]
    assert sum(map(len, surface.values())) == 512
    for points in surface.values():
        assert points.shape[1] == 3
        np.testing.assert_array_equal(points, points.round(4))


def test_surface_points_lie_on_the_outer_surface(meshes, surface):
    for name, points in surface.items():
        assert meshes[name].distance(points).max() < 0.001


@pytest.mark.slow
def test_surface_points_are_shared_out_by_area_and_spread(meshes, surface):
    area = {name: meshes[name].outer_area() for name in surface}
    total = sum(area.values())
    for name, points in surface.items():
        assert abs(len(points) - 512 * area[name] / total) < 1.0
        # A triangular lattice of n points on an area A is 1.07 sqrt(A / n) apart.
        distance = np.linalg.norm(points[:, None] - points[None], axis=-1)
        nearest = np.min(distance + np.diag(np.full(len(points), np.inf)), axis=1)
        assert nearest.min() > 0.5 * np.sqrt(area[name] / len(points))
