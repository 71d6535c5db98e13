"""The real arm's collision meshes, link by link, and distances to them.

Host-only witness for the collision spheres and the surface points: nothing here runs in the
jitted loop, and the package works without the meshes. A link's solid is the union of its
collision geoms; its surface is the part of their faces that no other geom of the link covers.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

# Surface samples per square metre of geom: 1 mm apart. They only pick the candidate triangles
# whose distance is then computed exactly.
_SAMPLES_PER_M2 = 1e6
_CANDIDATES = 6


@dataclass(frozen=True)
class LinkMesh:
    """Collision geometry of one link, in the link's frame [m].

    `parts` are closed `trimesh.Trimesh` solids; `triangles` (F, 3, 3) their faces, all parts
    together.
    """

    name: str
    parts: tuple
    triangles: np.ndarray
    _tree: cKDTree
    _tree_face: np.ndarray

    @classmethod
    def of_parts(cls, name: str, parts: list) -> LinkMesh:
        triangles = np.concatenate([np.asarray(part.triangles) for part in parts])
        rng = np.random.default_rng(0)
        n = int(_area(triangles).sum() * _SAMPLES_PER_M2)
        points, face = _sample_triangles(triangles, n, rng)
        corners = triangles.reshape(-1, 3)
        points = np.concatenate([points, corners])
        face = np.concatenate([face, np.repeat(np.arange(len(triangles)), 3)])
        outer = ~_inside_other_part(parts, points, face)
        return cls(name, tuple(parts), triangles, cKDTree(points[outer]), face[outer])

    def inside(self, points: np.ndarray) -> np.ndarray:
        """(N, 3) -> (N,) bool: inside any part."""
        result = np.zeros(len(points), bool)
        for part in self.parts:
            result |= winding_number(np.asarray(part.triangles), points) > 0.5
        return result

    def closest_points(self, points: np.ndarray) -> np.ndarray:
        """(N, 3) -> (N, 3) the nearest point of the link's outer surface to each."""
        from trimesh.triangles import closest_point

        _, index = self._tree.query(points, k=_CANDIDATES)
        feet = np.stack(
            [closest_point(self.triangles[self._tree_face[i]], points) for i in index.T]
        )
        nearest = np.linalg.norm(feet - points, axis=-1).argmin(axis=0)
        return feet[nearest, np.arange(len(points))]

    def distance(self, points: np.ndarray) -> np.ndarray:
        """(N, 3) -> (N,) unsigned distance [m] to the link's outer surface."""
        return np.linalg.norm(self.closest_points(points) - points, axis=1)

    def signed_distance(self, points: np.ndarray) -> np.ndarray:
        """(N, 3) -> (N,) distance [m], negative inside."""
        return np.where(self.inside(points), -1.0, 1.0) * self.distance(points)

    def sample_surface(self, n: int, rng: np.random.Generator) -> np.ndarray:
        """(n, 3) points, uniform by area on the outer surface."""
        kept = np.empty((0, 3))
        while len(kept) < n:
            points, face = _sample_triangles(self.triangles, 2 * n, rng)
            kept = np.concatenate([kept, points[~_inside_other_part(self.parts, points, face)]])
        return kept[:n]

    def outer_vertices(self) -> np.ndarray:
        """(V, 3) the mesh vertices on the outer surface."""
        corners = self.triangles.reshape(-1, 3)
        face = np.repeat(np.arange(len(self.triangles)), 3)
        return np.unique(corners[~_inside_other_part(self.parts, corners, face)], axis=0)

    def outer_area(self, n: int = 100_000) -> float:
        """Area [m^2] of the outer surface, by Monte Carlo where parts overlap."""
        total = float(_area(self.triangles).sum())
        if len(self.parts) == 1:
            return total
        points, face = _sample_triangles(self.triangles, n, np.random.default_rng(0))
        return total * float(1.0 - _inside_other_part(self.parts, points, face).mean())


def load_link_meshes(model_path: Path) -> dict[str, LinkMesh]:
    """Every link's collision geoms (meshes and boxes) of an MJCF model, keyed by body name.

    Raises ValueError for a collision geom that is neither a mesh nor a box.
    """
    import mujoco
    import trimesh

    model = mujoco.MjModel.from_xml_path(str(model_path))
    parts: dict[str, list] = {}
    for geom in range(model.ngeom):
        if model.geom_contype[geom] == 0 and model.geom_conaffinity[geom] == 0:
            continue  # visual only
        kind = model.geom_type[geom]
        if kind == mujoco.mjtGeom.mjGEOM_MESH:
            mesh = model.geom_dataid[geom]
            v0, nv = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
            f0, nf = model.mesh_faceadr[mesh], model.mesh_facenum[mesh]
            solid = trimesh.Trimesh(
                model.mesh_vert[v0 : v0 + nv].astype(float), model.mesh_face[f0 : f0 + nf]
            )
        elif kind == mujoco.mjtGeom.mjGEOM_BOX:
            solid = trimesh.creation.box(extents=2.0 * model.geom_size[geom])
        else:
            raise ValueError(f"geom {geom} of {model_path}: expected a mesh or a box, got {kind}")
        # MuJoCo moves a mesh to its inertial frame at compile time; geom_pos and geom_quat hold
        # the MJCF pose composed with that move.
        pose = np.eye(4)
        rotation = np.empty(9)
        mujoco.mju_quat2Mat(rotation, model.geom_quat[geom])
        pose[:3, :3], pose[:3, 3] = rotation.reshape(3, 3), model.geom_pos[geom]
        solid.apply_transform(pose)
        parts.setdefault(model.body(model.geom_bodyid[geom]).name, []).append(solid)
    return {name: LinkMesh.of_parts(name, solids) for name, solids in parts.items()}


def winding_number(triangles: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Generalized winding number of closed triangles (F, 3, 3) about points (N, 3) -> (N,).

    Solid angle of a triangle: Van Oosterom & Strackee, "The solid angle of a plane triangle",
    IEEE Trans. Biomed. Eng. 1983, eq. 8.
    """
    result = np.empty(len(points))
    for start in range(0, len(points), 4096):
        block = points[start : start + 4096]
        a, b, c = (triangles[None, :, i] - block[:, None] for i in range(3))
        la, lb, lc = (np.sqrt(np.einsum("nfi,nfi->nf", v, v)) for v in (a, b, c))
        numerator = np.einsum("nfi,nfi->nf", a, np.cross(b, c))
        denominator = (
            la * lb * lc
            + np.einsum("nfi,nfi->nf", a, b) * lc
            + np.einsum("nfi,nfi->nf", b, c) * la
            + np.einsum("nfi,nfi->nf", c, a) * lb
        )
        result[start : start + 4096] = np.arctan2(numerator, denominator).sum(1) / (2.0 * np.pi)
    return result


def _area(triangles: np.ndarray) -> np.ndarray:
    a, b, c = triangles[:, 0], triangles[:, 1], triangles[:, 2]
    return 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)


def _sample_triangles(
    triangles: np.ndarray, n: int, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """n points uniform by area (n, 3) and the face each lies on (n,)."""
    area = _area(triangles)
    face = rng.choice(len(triangles), size=n, p=area / area.sum())
    s, t = np.sqrt(rng.random((n, 1))), rng.random((n, 1))
    a, b, c = (triangles[face, i] for i in range(3))
    return (1.0 - s) * a + s * (1.0 - t) * b + s * t * c, face


def _inside_other_part(parts: Sequence[Any], points: np.ndarray, face: np.ndarray) -> np.ndarray:
    """(N,) bool: the point, on the given face of its own part, is inside another part."""
    covered = np.zeros(len(points), bool)
    if len(parts) == 1:
        return covered
    owner = np.repeat(np.arange(len(parts)), [len(part.faces) for part in parts])[face]
    for i, part in enumerate(parts):
        low, high = part.bounds
        mask = (owner != i) & np.all((points > low) & (points < high), axis=1)
        if mask.any():
            covered[mask] = winding_number(np.asarray(part.triangles), points[mask]) > 0.5
    return covered
