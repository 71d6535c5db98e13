"""The drawn arm follows the outline of the real one."""

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from drpbench.robot import PANDA


def _distance(points, solid):
    """Signed distance (n,) [m] of points in the solid's frame of the arm."""
    turn = Rotation.from_quat(solid.quaternion, scalar_first=True).as_matrix()
    local = (points - solid.position) @ turn
    half = np.array(solid.half_size)
    if solid.kind == "sphere":
        return np.linalg.norm(local, axis=1) - half[0]
    if solid.kind == "cylinder":
        local = np.stack([np.linalg.norm(local[:, :2], axis=1), local[:, 2]], axis=1)
        half = half[[0, 2]]
    out = np.abs(local) - half
    return np.linalg.norm(np.maximum(out, 0.0), axis=1) + np.minimum(out.max(axis=1), 0.0)


def test_the_real_surface_is_near_the_drawn_one():
    points, gaps = PANDA.surface, []
    for frame in np.unique(points.frame):
        local = points.local[points.frame == frame]
        solids = [solid for solid in PANDA.solids if solid.frame == frame]
        gaps.append(np.min([_distance(local, solid) for solid in solids], axis=0))
    gaps = np.abs(np.concatenate(gaps))
    assert np.mean(gaps) < 0.01 and gaps.max() < 0.04


def test_every_solid_is_whole():
    for solid in PANDA.solids:
        assert np.isclose(np.linalg.norm(solid.quaternion), 1.0)
        assert min(solid.half_size) > 0.0 and 0 <= solid.frame <= PANDA.hand
        if solid.kind != "box":
            assert solid.half_size[0] == solid.half_size[1]


def test_an_arm_without_a_figure_is_drawn_as_its_spheres():
    solids, spheres = replace(PANDA, figure=None).solids, PANDA.spheres
    assert len(solids) == spheres.count and {solid.kind for solid in solids} == {"sphere"}
    for solid, frame, center, radius in zip(
        solids, spheres.frame, spheres.local, spheres.radius, strict=True
    ):
        assert solid.frame == frame and solid.half_size == (radius,) * 3
        np.testing.assert_array_equal(solid.position, center)


def test_frames_are_named_after_their_first_links():
    assert PANDA.frame_names == (*(f"link{frame}" for frame in range(8)), "hand")
