"""Foxglove's messages from arrays. Times are nanoseconds, lengths metres, quaternions wxyz."""

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.JointStates_pb2 import JointStates
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.PackedElementField_pb2 import PackedElementField
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud
from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame
from foxglove_schemas_protobuf.SceneEntity_pb2 import SceneEntity
from foxglove_schemas_protobuf.SceneEntityDeletion_pb2 import SceneEntityDeletion
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate

from drpbench.geometry import SHAPES

WORLD = "world"
Numbers = Sequence[float] | np.ndarray
Color = tuple[float, ...]  # red, green, blue and, where it is not 1, opacity


def stamp(message: Any, time: int) -> Any:
    """Sets a message's time; returns the message."""
    message.timestamp.seconds, message.timestamp.nanos = divmod(time, 10**9)
    return message


def _set_pose(pose: Any, position: Iterable[float], quaternion: Iterable[float]) -> None:
    pose.position.x, pose.position.y, pose.position.z = position
    turn = pose.orientation
    turn.w, turn.x, turn.y, turn.z = quaternion


def _set_color(color: Any, value: Color) -> None:
    color.r, color.g, color.b, color.a = (*value, 1.0)[:4]


def entity(name: str, frame: str, time: int) -> SceneEntity:
    """A thing in the scene, without any shape yet; it moves with its frame."""
    return stamp(SceneEntity(id=name, frame_id=frame, frame_locked=True), time)


def add_solid(
    to: SceneEntity,
    kind: str,
    half_size: Numbers,
    position: Numbers,
    quaternion: Numbers,
    color: Color,
) -> None:
    """A box, cylinder or sphere. `half_size` as in `Primitives`: half extents along its own
    axes."""
    solids = {"box": to.cubes, "cylinder": to.cylinders, "sphere": to.spheres}[kind]
    solid = solids.add()
    _set_pose(solid.pose, map(float, position), map(float, quaternion))
    solid.size.x, solid.size.y, solid.size.z = (2.0 * float(half) for half in half_size)
    if kind == "cylinder":
        solid.bottom_scale = solid.top_scale = 1.0
    _set_color(solid.color, color)


def add_line(to: SceneEntity, points: Iterable[Numbers], thickness: float, color: Color) -> None:
    """A line through the points."""
    line = to.lines.add(thickness=thickness)
    for x, y, z in points:
        line.points.add(x=float(x), y=float(y), z=float(z))
    line.pose.orientation.w = 1.0
    _set_color(line.color, color)


def obstacle(
    name: str,
    frame: str,
    time: int,
    primitive: tuple[int, np.ndarray],
    pose: tuple[Numbers, Numbers],
    color: Color,
) -> SceneEntity:
    """One primitive: kind and half size, and its position and quaternion in the frame."""
    kind, half_size = primitive
    made = entity(name, frame, time)
    position, quaternion = pose
    add_solid(made, SHAPES[kind], half_size, position, quaternion, color)
    return made


def scene(entities: Iterable[SceneEntity], gone: Iterable[str] = (), time: int = 0) -> SceneUpdate:
    """Entities to show, replacing those of the same name, and names of those to remove."""
    update = SceneUpdate(entities=entities)
    for name in gone:
        stamp(update.deletions.add(type=SceneEntityDeletion.MATCHING_ID, id=name), time)
    return update


def transforms(time: int, frames: Sequence[str], poses: Iterable[float]) -> FrameTransforms:
    """Poses of frames in the world: of each x, y, z, and the quaternion's w, x, y, z, one after the
    other."""
    message, numbers = FrameTransforms(), iter(poses)
    for frame in frames:
        transform = message.transforms.add(parent_frame_id=WORLD, child_frame_id=frame)
        stamp(transform, time)
        vector, turn = transform.translation, transform.rotation
        vector.x, vector.y, vector.z = (next(numbers) for _ in range(3))
        turn.w, turn.x, turn.y, turn.z = (next(numbers) for _ in range(4))
    return message


def joints(time: int, names: Sequence[str], motion: Iterable[float]) -> JointStates:
    """Of each joint its position [rad] and its velocity [rad/s], one after the other."""
    message, numbers = stamp(JointStates(), time), iter(motion)
    for name in names:
        message.joints.add(name=name, position=next(numbers), velocity=next(numbers))
    return message


def point_cloud(time: int, points: np.ndarray) -> PointCloud:
    """Points (N, 3) [m] in the world frame."""
    cloud = PointCloud(
        frame_id=WORLD, point_stride=12, data=np.ascontiguousarray(points, "<f4").tobytes()
    )
    cloud.pose.orientation.w = 1.0
    for index, name in enumerate("xyz"):
        cloud.fields.add(name=name, offset=4 * index, type=PackedElementField.FLOAT32)
    return stamp(cloud, time)


def pose(time: int, position: Numbers, quaternion: Numbers) -> PoseInFrame:
    """A pose in the world frame."""
    message = stamp(PoseInFrame(frame_id=WORLD), time)
    _set_pose(message.pose, map(float, position), map(float, quaternion))
    return message


def log(time: int, text: str, level: Any = Log.INFO) -> Log:
    """A line of the episode's log."""
    return stamp(Log(level=level, message=text, name="drpbench"), time)
