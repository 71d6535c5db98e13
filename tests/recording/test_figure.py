"""The drawn arm follows the outline of the real one."""

import numpy as np
from scipy.spatial.transform import Rotation

from drpbench.recording.figure import arm_figure
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
        solids = [solid for solid in arm_figure() if solid.frame == frame]
        gaps.append(np.min([_distance(local, solid) for solid in solids], axis=0))
    gaps = np.abs(np.concatenate(gaps))
    assert np.mean(gaps) < 0.01 and gaps.max() < 0.04


def test_every_solid_is_whole():
    for solid in arm_figure():
        assert np.isclose(np.linalg.norm(solid.quaternion), 1.0)
        assert min(solid.half_size) > 0.0 and 0 <= solid.frame <= 8
        if solid.kind != "box":
            assert solid.half_size[0] == solid.half_size[1]
