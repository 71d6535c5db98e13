"""Foxglove's messages from arrays. Times are nanoseconds, lengths metres, quaternions wxyz."""

from collections.abc import Iterable, Sequence

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
Color = tuple[float, ...]  # red, green, blue and, where it is not 1, opacity


def stamp(message, time: int):
    """Sets a message's time; returns the message."""
    message.timestamp.seconds, message.timestamp.nanos = divmod(time, 10**9)
    return message


def _set_pose(pose, position, quaternion) -> None:
    pose.position.x, pose.position.y, pose.position.z = position
    turn = pose.orientation
    turn.w, turn.x, turn.y, turn.z = quaternion


def _set_color(color, value: Color) -> None:
    color.r, color.g, color.b, color.a = (*value, 1.0)[:4]


def entity(name: str, frame: str, time: int) -> SceneEntity:
    """A thing in the scene, without any shape yet; it moves with its frame."""
    return stamp(SceneEntity(id=name, frame_id=frame, frame_locked=True), time)


def add_solid(
    to: SceneEntity,
    kind: str,
    half_size: Sequence[float],
    position: Sequence[float],
    quaternion: Sequence[float],
    color: Color,
) -> None:
    """A box, cylinder or sphere. `half_size` as in `Primitives`: half extents along its own axes."""
    solids = {"box": to.cubes, "cylinder": to.cylinders, "sphere": to.spheres}[kind]
    solid = solids.add()
    _set_pose(solid.pose, map(float, position), map(float, quaternion))
    solid.size.x, solid.size.y, solid.size.z = (2.0 * float(half) for half in half_size)
    if kind == "cylinder":
        solid.bottom_scale = solid.top_scale = 1.0
    _set_color(solid.color, color)


def add_line(
    to: SceneEntity, points: Iterable[Sequence[float]], thickness: float, color: Color
) -> None:
    """A line through the points."""
    line = to.lines.add(thickness=thickness)
    for x, y, z in points:
        line.points.add(x=float(x), y=float(y), z=float(z))
    line.pose.orientation.w = 1.0
    _set_color(line.color, color)


def obstacle(
    name: str, frame: str, time: int, primitive: tuple[int, np.ndarray], pose, color: Color
) -> SceneEntity:
    """One primitive: kind and half size, and its position and quaternion in the frame."""
    kind, half_size = primitive
    made = entity(name, frame, time)
    add_solid(made, SHAPES[kind], half_size, *pose, color)
    return made


def scene(entities: Iterable[SceneEntity], gone: Iterable[str] = (), time: int = 0) -> SceneUpdate:
    """Entities to show, replacing those of the same name, and names of those to remove."""
    update = SceneUpdate(entities=entities)
    for name in gone:
        stamp(update.deletions.add(type=SceneEntityDeletion.MATCHING_ID, id=name), time)
    return update


class Transforms:
    """Poses of frames in the world, as one message that is filled again for each time."""

    def __init__(self, frames: Sequence[str]):
        self._message = FrameTransforms()
        for frame in frames:
            self._message.transforms.add(parent_frame_id=WORLD, child_frame_id=frame)
        self._transforms = list(self._message.transforms)

    def at(self, time: int, poses: Sequence[float]) -> FrameTransforms:
        """Of each frame x, y, z, and the quaternion's w, x, y, z, one after the other. Plain numbers: to
        take NumPy's is slow here."""
        seconds, nanos = divmod(time, 10**9)
        numbers = iter(poses)
        for transform in self._transforms:
            stamp, vector, turn = transform.timestamp, transform.translation, transform.rotation
            stamp.seconds, stamp.nanos = seconds, nanos
            vector.x, vector.y, vector.z = next(numbers), next(numbers), next(numbers)
            turn.w, turn.x, turn.y, turn.z = (
                next(numbers),
                next(numbers),
                next(numbers),
                next(numbers),
            )
        return self._message


class Joints:
    """Joint positions [rad] and velocities [rad/s], as one message that is filled again."""

    def __init__(self, names: Sequence[str]):
        self._message = JointStates()
        for name in names:
            self._message.joints.add(name=name)
        self._joints = list(self._message.joints)

    def at(self, time: int, motion: Sequence[float]) -> JointStates:
        """Of each joint its position and its velocity."""
        stamp(self._message, time)
        numbers = iter(motion)
        for joint in self._joints:
            joint.position, joint.velocity = next(numbers), next(numbers)
        return self._message


def point_cloud(time: int, points: np.ndarray) -> PointCloud:
    """Points (N, 3) [m] in the world frame."""
    cloud = PointCloud(
        frame_id=WORLD, point_stride=12, data=np.ascontiguousarray(points, "<f4").tobytes()
    )
    cloud.pose.orientation.w = 1.0
    for index, name in enumerate("xyz"):
        cloud.fields.add(name=name, offset=4 * index, type=PackedElementField.FLOAT32)
    return stamp(cloud, time)


def pose(time: int, position: Sequence[float], quaternion: Sequence[float]) -> PoseInFrame:
    """A pose in the world frame."""
    message = stamp(PoseInFrame(frame_id=WORLD), time)
    _set_pose(message.pose, map(float, position), map(float, quaternion))
    return message


def log(time: int, text: str, level: int = Log.INFO) -> Log:
    """A line of the episode's log."""
    return stamp(Log(level=level, message=text, name="drpbench"), time)
