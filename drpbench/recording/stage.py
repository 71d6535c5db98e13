"""What a video shows: arm, obstacles and the goal's ghost, as a MuJoCo scene."""

from collections.abc import Iterator, Sequence
from pathlib import Path

import mujoco
import numpy as np

from drpbench.geometry import BOX, CYLINDER, SHAPES, SPHERE
from drpbench.robot import GREY, WHITE, Robot

from .camera import CAMERAS, Camera
from .episode import Recording
from .motion import Motion
from .offscreen import Canvas

_GEOM = {
    BOX: mujoco.mjtGeom.mjGEOM_BOX,
    CYLINDER: mujoco.mjtGeom.mjGEOM_CYLINDER,
    SPHERE: mujoco.mjtGeom.mjGEOM_SPHERE,
}
FURNITURE = (0.56, 0.63, 0.71)
TABLE = (0.88, 0.86, 0.82)
MOVER = (0.20, 0.42, 0.86)
GHOST = (1.00, 0.60, 0.10)
CONTACT = (0.92, 0.07, 0.10)
_GHOST_OPACITY = 0.42
_APART = 0.004  # [m] nearer than this, ghost and arm are the same
_BACKGROUND = (0.97, 0.975, 0.98)


class Stage:
    """Draws instants of episodes of one arm, width x height pixels.

    The arm has its real meshes where they are wanted (`real`) and found, else it is drawn as
    solids. Raises RecordingError where nothing can be drawn.
    """

    def __init__(self, width: int, height: int, robot: Robot, real: bool = True):
        meshes = robot.meshes.find() if real and robot.meshes else None
        self.model = (_mesh_arm(robot, meshes) if meshes else _solid_arm(robot)).compile()
        self._data = mujoco.MjData(self.model)
        self._ghosts: dict[tuple[str, Camera], tuple[np.ndarray, np.ndarray]] = {}
        bodies = [self.model.body(body).name for body in self.model.geom_bodyid]
        # Hand and fingers are one: what is rigid in one frame is drawn as one.
        self._frame_of = {link.name: link.frame for link in robot.links}
        self._frame = [self._frame_of.get(name, -1) for name in bodies]
        self._canvas = Canvas(self.model, width, height)
        self._scene = mujoco.MjvScene(self.model, maxgeom=2000)
        for flag in (mujoco.mjtRndFlag.mjRND_SHADOW, mujoco.mjtRndFlag.mjRND_REFLECTION):
            self._scene.flags[flag] = False  # they cost six times the rest
        self._options = mujoco.MjvOption()
        self._options.geomgroup[:] = 1
        self.camera = mujoco.MjvCamera()
        self.aim(CAMERAS["corner"])

    def draw(
        self, episode: Recording, motion: Motion, instant: int, time: float | None = None
    ) -> np.ndarray:
        """The picture (height, width, 3) uint8 of an instant; `time` [s] in its caption is the
        instant's own unless given."""
        time = instant * episode.world.episode.period if time is None else time
        self._show_arm(episode.joint_position[instant])
        if link := motion.touched(instant):
            self._paint(CONTACT, link)
            self._add(SPHERE, (0.018,) * 3, motion.contact_point[instant], np.eye(3), CONTACT)
        for obstacle in _obstacles(episode, instant):
            self._add(*obstacle)
        caption = f"{episode.task} {episode.id}   {time:4.1f} s"
        picture, depth = self._canvas.draw(self._scene, caption)
        ghost, ghost_depth = self._ghost_of(episode)
        seen = ghost_depth < depth - _APART
        mixed = (1.0 - _GHOST_OPACITY) * picture[seen] + _GHOST_OPACITY * ghost[seen]
        picture[seen] = mixed.astype(np.uint8)
        return picture

    def aim(self, camera: Camera) -> None:
        """What is drawn from now on is seen from there."""
        camera.aim(self.camera)
        self._seen_from = camera

    def close(self) -> None:
        """Gives the drawing buffer back."""
        self._canvas.close()

    def _ghost_of(self, episode: Recording) -> tuple[np.ndarray, np.ndarray]:
        """The arm at the goal, alone: picture and depth. It stands still, so it is drawn once.

        Laid over the picture it is one even layer; transparent solids would show where they
        overlap.
        """
        key = episode.name, self._seen_from
        if key not in self._ghosts:
            self._show_arm(np.asarray(episode.problem.goal))
            self._paint(GHOST)
            self._ghosts[key] = self._canvas.draw(self._scene)
        return self._ghosts[key]

    def _show_arm(self, joints: np.ndarray) -> None:
        self._data.qpos[:] = joints
        mujoco.mj_kinematics(self.model, self._data)
        mujoco.mj_camlight(self.model, self._data)
        mujoco.mjv_updateScene(
            self.model,
            self._data,
            self._options,
            None,
            self.camera,
            mujoco.mjtCatBit.mjCAT_ALL,
            self._scene,
        )

    def _paint(self, color: Sequence[float], link: str | None = None) -> None:
        """Colours the arm, or what is rigid in one frame with a link of it."""
        for index in range(self._scene.ngeom):
            geom = self._scene.geoms[index]
            if geom.objtype != mujoco.mjtObj.mjOBJ_GEOM:
                continue
            if link is None or self._frame[geom.objid] == self._frame_of[link]:
                geom.rgba[:3], geom.matid = color, -1

    def _add(
        self,
        kind: int,
        half_size: Sequence[float] | np.ndarray,
        position: np.ndarray,
        rotation: np.ndarray,
        color: Sequence[float],
    ) -> None:
        x, y, z = map(float, half_size)
        size = [x, z, 0.0] if kind == CYLINDER else [x, y, z]
        mujoco.mjv_initGeom(
            self._scene.geoms[self._scene.ngeom],
            _GEOM[kind],
            np.array(size),
            np.asarray(position, np.float64),
            np.asarray(rotation, np.float64).ravel(),
            np.array([*color, 1.0], np.float32),
        )
        self._scene.ngeom += 1


def _obstacles(episode: Recording, instant: int) -> Iterator[tuple]:
    static, boxes = episode.problem.obstacles, episode.boxes
    for k in np.flatnonzero(static.mask):
        below = static.position[k, 2] + static.half_size[k, 2] < 1e-3
        yield (
            int(static.kind[k]),
            static.half_size[k],
            static.position[k],
            static.rotation[k],
            TABLE if below else FURNITURE,
        )
    for i in np.flatnonzero(boxes.active[instant]):
        yield (
            BOX,
            boxes.half_size[instant, i],
            boxes.position[instant, i],
            boxes.rotation[instant, i],
            MOVER,
        )


def _solid_arm(robot: Robot) -> mujoco.MjSpec:
    spec = robot.spec()
    for solid in robot.solids:
        geom = spec.body(robot.frame_names[solid.frame]).add_geom()
        x, _, z = solid.half_size
        geom.type = _GEOM[SHAPES.index(solid.kind)]
        geom.size = [x, z, 0] if solid.kind == "cylinder" else solid.half_size
        geom.pos, geom.quat = solid.position, solid.quaternion
        geom.rgba = [*solid.color, 1.0]
        geom.contype = geom.conaffinity = 0
    return _lit(spec)


def _mesh_arm(robot: Robot, path: Path) -> mujoco.MjSpec:
    """The arm with its visual meshes; with the collision meshes where the model has no others.

    Joints beyond the arm's own, its fingers', are fixed where the robot's links say.
    """
    spec = mujoco.MjSpec.from_file(str(path))
    moved = {link.name: link.offset for link in robot.links if any(link.offset)}
    visual = [geom for geom in spec.geoms if geom.classname.name == "visual" or geom.group == 2]
    for geom in list(spec.geoms):
        if visual and geom not in visual:
            spec.delete(geom)
        elif not visual:
            geom.rgba = [*(GREY if geom.parent.name in moved else WHITE), 1.0]
    for elements in (spec.tendons, spec.equalities, spec.actuators, spec.keys, spec.lights):
        for element in list(elements):
            spec.delete(element)
    for joint in list(spec.joints)[robot.joints :]:
        spec.delete(joint)
    for name, offset in moved.items():
        spec.body(name).pos = offset
    return _lit(spec)


def _lit(spec: mujoco.MjSpec) -> mujoco.MjSpec:
    """With a light, and a bright background."""
    light = spec.worldbody.add_light()
    light.pos, light.dir = [-1.2, -1.0, 2.6], [0.65, 0.25, -1.0]
    light.type = mujoco.mjtLightType.mjLIGHT_DIRECTIONAL
    light.diffuse, light.specular = [0.55, 0.55, 0.55], [0.15, 0.15, 0.15]
    spec.visual.quality.numslices, spec.visual.quality.numstacks = 20, 10
    head = spec.visual.headlight
    head.ambient, head.diffuse, head.specular = [0.38] * 3, [0.38] * 3, [0.05] * 3
    sky = spec.add_texture()
    sky.name, sky.type = "sky", mujoco.mjtTexture.mjTEXTURE_SKYBOX
    sky.builtin = mujoco.mjtBuiltin.mjBUILTIN_GRADIENT
    sky.rgb1, sky.rgb2, sky.width, sky.height = _BACKGROUND, (0.82, 0.86, 0.90), 64, 384
    return spec
