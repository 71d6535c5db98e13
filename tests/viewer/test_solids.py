"""The triangles that the page draws."""

import numpy as np
import pytest

from drpbench.geometry import BOX, CYLINDER, SPHERE
from drpbench.robot import PANDA
from drpbench.viewer.solids import joined, links, solid

SIZES = {BOX: (0.1, 0.2, 0.3), CYLINDER: (0.1, 0.1, 0.4), SPHERE: (0.2,) * 3}
VOLUMES = {BOX: 8 * 0.1 * 0.2 * 0.3, CYLINDER: np.pi * 0.01 * 0.8, SPHERE: 4 / 3 * np.pi * 0.008}


def volume(mesh):
    """By the divergence theorem: positive only where all triangles show their outsides."""
    vertices, faces = mesh
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    return np.sum(a * np.cross(b, c)) / 6


@pytest.mark.parametrize("kind", SIZES)
def test_a_solid_has_the_volume_and_the_extents_of_its_primitive(kind):
    mesh = solid(kind, SIZES[kind])
    # A circle of 28 corners lacks 0.8 % of its area.
    assert volume(mesh) == pytest.approx(VOLUMES[kind], rel=1e-9 if kind == BOX else 0.03)
    assert np.abs(mesh[0]).max(axis=0) == pytest.approx(SIZES[kind], rel=1e-9)


@pytest.mark.parametrize("kind", SIZES)
def test_every_triangle_looks_away_from_the_middle(kind):
    vertices, faces = solid(kind, SIZES[kind])
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    outward = np.sum(np.cross(b - a, c - a) * (a + b + c), axis=1)
    assert (outward > -1e-12).all()


def test_the_links_are_all_of_the_arms_solids():
    meshes = links(PANDA)
    assert {frame for frame, _ in meshes} == set(range(PANDA.hand + 1))
    sizes = [np.array(piece.half_size) for piece in PANDA.solids]
    assert len({id(mesh) for mesh in meshes.values()}) == len(
        {(piece.frame, piece.color) for piece in PANDA.solids}
    )
    whole = volume(joined(list(meshes.values())))
    parts = [
        VOLUMES[kind] / np.prod(SIZES[kind]) * np.prod(size)
        for kind, size in zip(
            ({"box": BOX, "cylinder": CYLINDER, "sphere": SPHERE}[p.kind] for p in PANDA.solids),
            sizes,
            strict=True,
        )
    ]
    assert whole == pytest.approx(sum(parts), rel=0.03)
