"""The three-dimensional picture of a simulation, as nodes of a viser scene that all browsers
share."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import jax.numpy as jnp
import numpy as np
import viser

from drpbench.geometry import BOX, matrix_to_quaternion
from drpbench.recording.mcap_file import MODIFIED
from drpbench.recording.stage import CONTACT, FURNITURE, GHOST, MOVER
from drpbench.robot import Robot

from .furniture import Furniture
from .moment import Frames, Moment
from .solids import Mesh, links, solid

_ADDED = (0.16, 0.62, 0.60)
_GROUND = (0.50, 0.52, 0.55)  # dark enough for a white arm to stand out, under this room's light
_POINT, _BOX_POINT = (0.16, 0.19, 0.26), (0.08, 0.20, 0.55)
_TARGET = np.array(
    [0.30, -0.10, 0.36]
)  # [m] what the camera looks at, from behind the arm as in videos
_DISTANCE, _AZIMUTH, _ELEVATION = 2.1, 48.0, -22.0  # [m], [deg]
_APART = 0.006, 0.02  # [m], [rad] nearer than this, a ghost's link and the arm's are the same

Dragged = Callable[[str, int, np.ndarray, bool], None]
"""Is told what is dragged, `piece` or `box`, which, where to [m], and whether it is let go."""


def rgb(color: tuple[float, ...]) -> tuple[int, int, int]:
    """A colour of 0 to 1 as viser has it."""
    red, green, blue = (round(255 * part) for part in color[:3])
    return red, green, blue


@dataclass
class _Box:
    """One of the task's boxes."""

    frame: viser.FrameHandle
    solid: viser.MeshHandle
    points: viser.PointCloudHandle
    shape: Any = None
    """Its size, and which of its points are seen, as they were drawn."""


class Drawing:
    """What is seen of the world. `begin` with each new scene, then `show` its moments."""

    def __init__(self, server: viser.ViserServer, robot: Robot, dragged: Dragged):
        self._server, self._scene, self._dragged = server, server.scene, dragged
        self._robot = robot
        self._furnish_the_room()
        self._arm = self._figure("/arm", rgb, 1.0)
        self._ghost = self._figure("/goal", lambda part: rgb(GHOST), 0.32)
        self._modified = self._figure("/dcp_rmp/goal", lambda part: rgb(MODIFIED), 0.30)
        self._points = self._cloud("/points", _POINT)
        self._line = self._scene.add_line_segments(
            "/dcp_rmp/closest",
            np.zeros((1, 2, 3), np.float32),
            colors=rgb(CONTACT),
            thickness=0.006,
            visible=False,
        )
        self._touch = self._mesh("/contact", solid(2, (0.02,) * 3), rgb(CONTACT), visible=False)
        self.handle = self._scene.add_transform_controls(
            "/goal_handle", scale=0.22, line_width=3.0, depth_test=False, opacity=0.85
        )
        self._pieces: dict[int, viser.MeshHandle] = {}
        self._boxes: list[_Box] = []
        self._red: str | None = None
        self._goal: np.ndarray | None = None
        self._static = np.zeros((0, 3))
        self.cloud_shown, self.ghost_shown, self.reaction_shown = True, True, True
        """Whether things can be dragged."""

    def _furnish_the_room(self) -> None:
        scene = self._scene
        scene.set_background_image(_sky())
        scene.configure_default_lights(enabled=False)
        scene.configure_environment_map(None)
        scene.add_light_ambient("/light/everywhere", intensity=1.1)
        scene.add_light_hemisphere(
            "/light/sky", sky_color=(255, 255, 255), ground_color=(190, 186, 178), intensity=1.3
        )
        scene.add_light_directional(
            "/light/sun", intensity=1.9, cast_shadow=True, position=(1.2, 1.6, 3.0)
        )
        scene.add_grid(
            "/ground",
            width=3.0,
            height=3.0,
            cell_size=0.1,
            section_size=0.5,
            cell_color=(222, 226, 232),
            section_color=(200, 206, 214),
            position=(0.0, 0.0, -0.002),
            shadow_opacity=0.15,
        )
        azimuth, elevation = np.radians(_AZIMUTH), np.radians(_ELEVATION)
        forward = np.array(
            [
                np.cos(elevation) * np.cos(azimuth),
                np.cos(elevation) * np.sin(azimuth),
                np.sin(elevation),
            ]
        )
        camera = self._server.initial_camera
        camera.fov = np.radians(45.0)
        camera.look_at, camera.position = _TARGET, _TARGET - _DISTANCE * forward

        @self._server.on_client_connect
        async def _(client: viser.ClientHandle) -> None:
            aspect = client.camera.aspect
            if (
                aspect < 1.0
            ):  # a phone held upright: step back for the width; the controls are below
                target = _TARGET - np.array([0.0, 0.0, 0.45])
                client.camera.position = target - 0.9 / max(aspect, 0.3) * _DISTANCE * forward
                client.camera.look_at = target

    # -- nodes --

    def _mesh(
        self, name: str, mesh: Mesh, color: tuple[int, int, int], **options: Any
    ) -> viser.MeshHandle:
        vertices, faces = mesh
        return self._scene.add_mesh_simple(
            name, vertices.astype(np.float32), faces, color=color, **options
        )

    def _cloud(self, name: str, color: tuple[float, ...]) -> viser.PointCloudHandle:
        return self._scene.add_point_cloud(
            name,
            np.zeros((1, 3), np.float32),
            colors=rgb(color),
            point_size=0.005,
            point_shape="circle",
            point_shading="flat",
        )

    def _figure(
        self,
        name: str,
        paint: Callable[[tuple[float, ...]], tuple[int, int, int]],
        opacity: float,
    ) -> tuple[
        list[viser.FrameHandle], dict[tuple[int, tuple[float, float, float]], viser.MeshHandle]
    ]:
        """Frames of the links, with their meshes; those of a ghost are of one colour, and
        see-through."""
        ghost = opacity < 1.0
        frames = [
            self._scene.add_frame(f"{name}/{i}", show_axes=False, visible=not ghost)
            for i in range(self._robot.hand + 1)
        ]
        meshes = {}
        for number, ((frame, color), mesh) in enumerate(links(self._robot).items()):
            if ghost and frame < 2:
                continue  # they stay, or turn, where the arm's are, and would flicker with them
            meshes[frame, color] = self._mesh(
                f"{name}/{frame}/{number}",
                mesh,
                paint(color),
                opacity=opacity if ghost else None,
                cast_shadow=not ghost,
                receive_shadow=not ghost,
            )
        return frames, meshes

    def begin(self, furniture: Furniture, moment: Moment) -> None:
        """A new scene: its pieces, and the task's boxes."""
        for handle in [*self._pieces.values(), *(box.frame for box in self._boxes)]:
            handle.remove()
        self._pieces, self._boxes, self._goal = {}, [], None
        movable = furniture.movable
        quaternion = np.asarray(matrix_to_quaternion(jnp.asarray(furniture.rotation)))
        for k in np.flatnonzero(furniture.present):
            added = int(k) in furniture.added
            color = _ADDED if added else FURNITURE if movable[k] else _GROUND
            handle = self._mesh(
                f"/furniture/{k}",
                solid(furniture.kind[k], furniture.half_size[k]),
                rgb(color),
                position=furniture.position[k],
                wxyz=quaternion[k],
            )
            self._pieces[int(k)] = handle
            if movable[k]:
                self._draggable("piece", int(k), handle, handle)
        for i in range(len(moment.box_active)):
            frame = self._scene.add_frame(f"/boxes/{i}", show_axes=False, visible=False)
            cube = self._mesh(f"/boxes/{i}/solid", solid(BOX, (0.5,) * 3), rgb(MOVER))
            self._boxes.append(_Box(frame, cube, self._cloud(f"/boxes/{i}/points", _BOX_POINT)))
            self._draggable("box", i, cube, frame)
        self.show(moment, furniture, None)
        self.put_handle(moment)

    def _draggable(self, what: str, index: int, handle: viser.MeshHandle, placed: Any) -> None:
        """Dragging `handle` is told of as moving `placed`, the node whose position is the
        thing's."""
        grip = np.zeros(3)

        # As a coroutine, because viser calls functions out of order.
        @handle.on_drag("left")
        async def _(event: Any) -> None:
            nonlocal grip
            if event.phase == "start":
                grip = np.asarray(placed.position) - np.asarray(event.start_position)
            place = np.asarray(event.end_position) + grip
            self._dragged(what, index, place, event.phase == "end")

    def put_handle(self, moment: Moment) -> None:
        """The goal's handle back to where the goal is."""
        self.handle.position, self.handle.wxyz = moment.goal_position, moment.goal_quaternion

    # -- moments --

    def show(self, moment: Moment, furniture: Furniture, touching: str | None) -> None:
        """Draws the world as it is now; `touching` is the link that touched in the last control
        step."""
        with self._server.atomic():
            self._show_arm(moment, touching)
            for k, handle in self._pieces.items():
                _put(handle, furniture.position[k])
            for i, box in enumerate(self._boxes):
                self._show_box(moment, i, box)
            self._show_points(moment)
            self._show_goal(moment)
            self._show_reaction(moment)

    def _show_arm(self, moment: Moment, touching: str | None) -> None:
        frames, meshes = self._arm
        _pose(frames, moment.arm)
        names = self._robot.link_names
        now = names[moment.link] if moment.clearance < 0.0 else touching
        if now != self._red:
            self._red = now
            frame = None if now is None else self._robot.links[names.index(now)].frame
            for (of, color), mesh in meshes.items():
                mesh.color = rgb(CONTACT if of == frame else color)
        if now:
            self._touch.position = moment.contact_point
        _visible(self._touch, now is not None)

    def _show_box(self, moment: Moment, i: int, box: _Box) -> None:
        _visible(box.frame, bool(moment.box_active[i]))
        if not box.frame.visible:
            return
        place, rotation = moment.box_position[i], moment.box_rotation[i]
        width, depth, height = (2.0 * moment.box_half_size[i]).tolist()
        size = (width, depth, height)
        points, seen = moment.points_of(i)
        if box.shape != (shape := (size, seen.tobytes())):
            box.shape, box.solid.scale = shape, size
            # The points are fixed to the box, and need not be sent again when it moves.
            box.points.points = (points[seen] - place) @ rotation
        _visible(box.points, self.cloud_shown and bool(seen.any()))
        box.frame.position, box.frame.wxyz = place, moment.box_quaternion[i]

    def _show_points(self, moment: Moment) -> None:
        points, seen = moment.points_of(None)
        points = points[seen]
        _visible(self._points, self.cloud_shown and len(points) > 0)
        if self._points.visible and not np.array_equal(points, self._static):
            self._static = self._points.points = points

    def _show_goal(self, moment: Moment) -> None:
        frames, _ = self._ghost
        if self._goal is None or not np.array_equal(self._goal, moment.goal[0]):
            self._goal = moment.goal[0]
            _pose(frames, moment.goal)
        apart = _apart(moment.goal, moment.arm)
        for frame, away in zip(frames, apart, strict=True):
            _visible(frame, self.ghost_shown and bool(away))

    def _show_reaction(self, moment: Moment) -> None:
        reaction, modified, (frames, _) = moment.reaction, moment.modified, self._modified
        apart, shown = np.zeros(len(frames), bool), False
        if self.reaction_shown and reaction is not None and modified is not None:
            shown = bool(reaction.active)
        if shown and reaction is not None and modified is not None:
            _pose(frames, modified)
            ends = [reaction.arm_point, reaction.obstacle_point]
            self._line.points = np.array([ends], np.float32)
            apart = _apart(modified, moment.arm)
        for frame, away in zip(frames, apart, strict=True):
            _visible(frame, bool(away))
        _visible(self._line, shown)


def _pose(frames: Sequence[viser.FrameHandle], poses: Frames) -> None:
    for frame, position, quaternion in zip(frames, *poses, strict=True):
        frame.position, frame.wxyz = position, quaternion


def _apart(ghost: Frames, arm: Frames) -> np.ndarray:
    """(F,) bool: links of a ghost that would not flicker with those of the arm."""
    length, angle = _APART
    off = np.linalg.norm(ghost[0] - arm[0], axis=1)
    cosine = np.abs(np.sum(ghost[1] * arm[1], axis=1))  # of half the angle
    return (off > length) | (cosine < np.cos(angle / 2))


def _put(node: Any, position: np.ndarray) -> None:
    if not np.array_equal(node.position, position):
        node.position = position


def _visible(node: Any, visible: bool) -> None:
    if node.visible != visible:
        node.visible = visible


def _sky() -> np.ndarray:
    """A light background, a little darker towards the bottom."""
    top, bottom = np.array([246.0, 248.0, 251.0]), np.array([222.0, 227.0, 234.0])
    ramp = np.linspace(0.0, 1.0, 256)[:, None, None]
    return np.broadcast_to(top + ramp * (bottom - top), (256, 4, 3)).astype(np.uint8)
