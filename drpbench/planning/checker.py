"""Collision of the arm with a static scene and with itself, by C MuJoCo on the host.

A model is compiled once, with `MAX_OBSTACLES` empty slots; a scene is written into the slots in
place, so that changing it costs microseconds and not a compilation. A check runs MuJoCo's
kinematics and collision detection and nothing else.
"""

from __future__ import annotations

import json
from pathlib import Path

import mujoco
import numpy as np

from drpbench.errors import DrpbenchError
from drpbench.geometry import BOX, CYLINDER, MAX_OBSTACLES, SPHERE, Obstacles
from drpbench.robot import PANDA, Robot

# Collision bits: links against obstacles, and links against links (by pairs). The base does not
# move and stands on the table, so no motion puts it into an obstacle; see `base_clearance`.
_OBSTACLE, _SELF = 1, 2
_GEOM_TYPE = {
    BOX: mujoco.mjtGeom.mjGEOM_BOX,
    CYLINDER: mujoco.mjtGeom.mjGEOM_CYLINDER,
    SPHERE: mujoco.mjtGeom.mjGEOM_SPHERE,
}


def _self_pairs(robot: Robot) -> set[frozenset[str]]:
    """Pairs of links that can touch: those of the frames that can."""
    pairs = set()
    for block in robot.self_collision_blocks:
        first, second = ([one.name for one in robot.links if one.frame in group] for group in block)
        pairs |= {frozenset((a, b)) for a in first for b in second}
    return pairs


class Checker:
    """Clearance of the arm in one scene at a time.

    `margin` [m] is the largest clearance that is told apart: everything farther reads as `margin`.
    """

    def __init__(self, spec: mujoco.MjSpec, margin: float, robot: Robot = PANDA):
        """`spec` is the arm `robot` with its collision geoms and a site `grip`."""
        self.margin, self.robot = margin, robot
        self.model = _compile(spec, margin, robot)
        self.data = mujoco.MjData(self.model)
        self._grip = self.model.site("grip").id
        model = self.model
        self._bodies = np.array([model.body(f"slot{i}").id for i in range(MAX_OBSTACLES)])
        self._geoms = np.array([model.geom(f"slot{i}").id for i in range(MAX_OBSTACLES)])
        self._volumes = model.body_bvhadr[self._bodies]
        self.obstacle_count = 0
        self._clear()

    def _clear(self) -> None:
        for bits in (self.model.geom_contype, self.model.geom_conaffinity):
            bits[self._geoms] = 0
        for bits in (self.model.body_contype, self.model.body_conaffinity):
            bits[self._bodies] = 0

    def set_obstacles(self, obstacles: Obstacles) -> None:
        """Puts the obstacles of one scene into the model, in place of those that were there.

        The first one is what the arm stands on. Masked ones are left out. Raises DrpbenchError for
        more than MAX_OBSTACLES.
        """
        self._clear()
        model, there = self.model, obstacles.present()
        if there.count > MAX_OBSTACLES:
            raise DrpbenchError(
                f"a scene of {there.count} obstacles: MuJoCo's model of the arm has room for "
                f"{MAX_OBSTACLES}"
            )
        kind, half_size = there.kind, there.half_size
        position, quaternion = there.position, there.quaternion
        for slot in range(there.count):
            geom, body, volume = self._geoms[slot], self._bodies[slot], self._volumes[slot]
            half = np.asarray(half_size[slot], float)
            model.geom_type[geom] = _GEOM_TYPE[int(kind[slot])]
            # MuJoCo's sizes: (r, r, r) and (r, h/2, -) for spheres and cylinders, half extents
            # else.
            model.geom_size[geom] = half if kind[slot] != CYLINDER else (half[0], half[2], 0.0)
            if kind[slot] == BOX:
                model.geom_rbound[geom] = np.linalg.norm(half)
            elif kind[slot] == CYLINDER:
                model.geom_rbound[geom] = np.hypot(half[0], half[2])
            else:
                model.geom_rbound[geom] = half[0]
            model.geom_aabb[geom] = (0, 0, 0, *half)
            model.bvh_aabb[volume] = (0, 0, 0, *half)
            model.body_pos[body] = position[slot]
            model.body_quat[body] = quaternion[slot] / np.linalg.norm(quaternion[slot])
            model.geom_conaffinity[geom] = model.body_conaffinity[body] = _OBSTACLE
        self.obstacle_count = there.count

    def clearance(self, q: np.ndarray) -> float:
        """Smallest distance [m] of the arm at joints `q` (J,), at most `margin`.

        Negative is a penetration, of an obstacle or of the arm with itself; a distance between two
        links that do not touch does not count.
        """
        self.data.qpos[: self.robot.joints] = q
        mujoco.mj_kinematics(self.model, self.data)
        mujoco.mj_collision(self.model, self.data)
        if self.data.ncon == 0:
            return self.margin
        return min(float(self.data.contact.dist.min()), self.margin)

    def free(self, q: np.ndarray, clearance: float = 0.0) -> bool:
        """Whether the arm at `q` (J,) is farther than `clearance` from all, and not in itself."""
        return self.clearance(q) > clearance

    def base_clearance(self) -> float:
        """Distance [m], at most `margin`, of the immovable base from all obstacles but the
        table."""
        mujoco.mj_kinematics(self.model, self.data)
        base = self.model.body(self.robot.links[0].name)
        own = range(base.geomadr[0], base.geomadr[0] + base.geomnum[0])
        nearest = self.margin
        for obstacle in self._geoms[1 : self.obstacle_count]:
            for geom in own:
                distance = mujoco.mj_geomDistance(
                    self.model, self.data, geom, obstacle, self.margin, None
                )
                nearest = min(nearest, distance)
        return nearest

    def contacts(self, q: np.ndarray) -> list[tuple[str, str, float]]:
        """Pairs (link, link or "obstacle i") within the margin at `q` (J,), with distances [m]."""
        self.clearance(q)
        found = []
        for (a, b), distance in zip(self.data.contact.geom, self.data.contact.dist, strict=True):
            names = [self.model.body(self.model.geom_bodyid[g]).name for g in (a, b)]
            names = [n.replace("slot", "obstacle ") for n in names]
            found.append((*sorted(names), float(distance)))
        return sorted(found, key=lambda contact: contact[2])

    def grip_pose(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Position (3,) and rotation matrix (3, 3) of the grip frame at `q` (J,)."""
        self.data.qpos[: self.robot.joints] = q
        mujoco.mj_kinematics(self.model, self.data)
        return (
            self.data.site_xpos[self._grip].copy(),
            self.data.site_xmat[self._grip].reshape(3, 3).copy(),
        )


def sphere_checker(margin: float = 0.02, robot: Robot = PANDA) -> Checker:
    """Checker on the arm's collision spheres."""
    spec = robot.spec()
    by_link = json.loads((robot.folder / "spheres.json").read_text())
    for link in robot.link_names:
        for x, y, z, radius in by_link.get(link, []):
            geom = spec.body(link).add_geom()
            geom.type, geom.size, geom.pos = mujoco.mjtGeom.mjGEOM_SPHERE, [radius, 0, 0], [x, y, z]
    return Checker(spec, margin, robot)


def mesh_checker(model: Path, margin: float = 0.02, robot: Robot = PANDA) -> Checker:
    """Checker on the real meshes, each by its convex hull, the fingers' too: a certificate may ask
    for more clearance than the fingers need. `model` is what `robot.meshes.find` returns.

    Raises DrpbenchError for an arm without real meshes.
    """
    if robot.meshes is None:
        raise DrpbenchError(f"expected an arm with real meshes, got {robot.name!r}, which has none")
    return Checker(robot.meshes.spec(model, finger_pieces=1), margin, robot)


def _compile(spec: mujoco.MjSpec, margin: float, robot: Robot) -> mujoco.MjModel:
    """The arm of `spec` with obstacle slots, set up for collision detection alone."""
    for geom in spec.geoms:
        geom.contype, geom.conaffinity = _OBSTACLE | _SELF, _SELF
    pairs = _self_pairs(robot)
    for i, a in enumerate(robot.link_names):
        for b in robot.link_names[i + 1 :]:
            if frozenset((a, b)) not in pairs:
                spec.add_exclude(bodyname1=a, bodyname2=b)
    for slot in range(MAX_OBSTACLES):
        # One static body for each obstacle: MuJoCo's broad phase works on bodies.
        body = spec.worldbody.add_body()
        body.name, body.mass, body.inertia = f"slot{slot}", 1.0, [1.0, 1.0, 1.0]
        body.explicitinertial = True
        geom = body.add_geom()
        geom.name, geom.type, geom.size = f"slot{slot}", mujoco.mjtGeom.mjGEOM_BOX, [0.1, 0.1, 0.1]
        geom.margin = margin
        geom.contype = geom.conaffinity = 0
    spec.option.enableflags = 0
    spec.option.disableflags = int(mujoco.mjtDisableBit.mjDSBL_FILTERPARENT)
    return spec.compile()
