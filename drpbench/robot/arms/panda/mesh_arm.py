"""The arm with its real collision meshes, as a MuJoCo specification: what referees are built
from."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from .fingers import FINGER_HEIGHT, FINGER_OPENING

if TYPE_CHECKING:
    import mujoco


def mesh_arm(
    model: Path, finger_pieces: int = 8, finger_opening: float = FINGER_OPENING
) -> mujoco.MjSpec:
    """The arm of `model`, an MJCF as `find_mesh_model` finds it: seven joints and collision geoms.

    Visual geoms, actuators, tendons and keys are left out, the fingers are fixed open, and a site
    `grip` is added. MuJoCo collides a mesh's convex hull. Every link's mesh is its hull to within
    0.9 mm, but a finger's hull has 1.8 times its volume and stands out by 8 mm where the fingers
    face each other; so a finger's mesh is cut into `finger_pieces` slabs along z, and the hulls of
    8 of them fill no more than 2.2 mm (the screws' pockets). One piece leaves the finger whole.
    """
    import mujoco

    spec = mujoco.MjSpec.from_file(str(model))
    for geom in list(spec.geoms):
        if geom.classname.name == "visual" or geom.group == 2:
            spec.delete(geom)
    for elements in (spec.tendons, spec.equalities, spec.actuators, spec.keys):
        for element in list(elements):
            spec.delete(element)
    for joint in list(spec.joints):
        if joint.name.startswith("finger"):
            spec.delete(joint)
    spec.body("left_finger").pos = [0, finger_opening, FINGER_HEIGHT]
    spec.body("right_finger").pos = [0, -finger_opening, FINGER_HEIGHT]
    grip = spec.body("hand").add_site()
    grip.name, grip.pos = "grip", [0, 0, 0.1]
    if finger_pieces > 1:
        _cut_fingers(spec, finger_pieces)
    return spec


def _cut_fingers(spec: mujoco.MjSpec, pieces: int) -> None:
    import mujoco

    whole = spec.compile()
    cut = []
    for geom in range(whole.ngeom):
        body = whole.body(whole.geom_bodyid[geom]).name
        if body.endswith("finger") and whole.geom_type[geom] == mujoco.mjtGeom.mjGEOM_MESH:
            vertices, faces = _mesh_in_body(whole, geom)
            cut.append((body, slabs(vertices, faces, pieces)))
    for body in {body for body, _ in cut}:
        for geom in list(spec.body(body).geoms):
            if geom.type == mujoco.mjtGeom.mjGEOM_MESH:
                spec.delete(geom)
    for number, (body, parts) in enumerate(cut):
        for slab, points in enumerate(parts):
            mesh = spec.add_mesh()
            mesh.name, mesh.uservert = f"finger_mesh{number}_slab{slab}", points.ravel()
            geom = spec.body(body).add_geom()
            geom.type, geom.meshname, geom.group = mujoco.mjtGeom.mjGEOM_MESH, mesh.name, 3


def _mesh_in_body(model: mujoco.MjModel, geom: int) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (V, 3) [m] in the body's frame and faces (F, 3) of a mesh geom."""
    import mujoco

    mesh = model.geom_dataid[geom]
    v0, nv = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
    f0, nf = model.mesh_faceadr[mesh], model.mesh_facenum[mesh]
    rotation = np.empty(9)
    mujoco.mju_quat2Mat(rotation, model.geom_quat[geom])
    vertices = model.mesh_vert[v0 : v0 + nv] @ rotation.reshape(3, 3).T + model.geom_pos[geom]
    return vertices, model.mesh_face[f0 : f0 + nf]


def slabs(vertices: np.ndarray, faces: np.ndarray, pieces: int) -> list[np.ndarray]:
    """A closed mesh's surface cut at equal distances along z: the corners (n, 3) of each piece.

    `vertices` is (V, 3), `faces` (F, 3). The pieces' convex hulls together hold the whole mesh.
    """
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    edges = np.unique(np.sort(edges, axis=1), axis=0)
    start, end = vertices[edges[:, 0]], vertices[edges[:, 1]]
    cuts = np.linspace(vertices[:, 2].min(), vertices[:, 2].max(), pieces + 1)

    def crossing(z: float) -> np.ndarray:
        across = (start[:, 2] - z) * (end[:, 2] - z) < 0.0
        a, b = start[across], end[across]
        return a + ((z - a[:, 2]) / (b[:, 2] - a[:, 2]))[:, None] * (b - a)

    parts = []
    for low, high in zip(cuts[:-1], cuts[1:], strict=True):
        within = (vertices[:, 2] >= low) & (vertices[:, 2] <= high)
        parts.append(np.concatenate([vertices[within], crossing(low), crossing(high)]))
    return parts
