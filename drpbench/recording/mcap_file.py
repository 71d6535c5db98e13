"""An episode as an MCAP file with Foxglove's schemas."""

import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from foxglove_schemas_protobuf.Log_pb2 import Log
from google.protobuf.wrappers_pb2 import DoubleValue
from mcap.writer import CompressionType
from mcap_protobuf.writer import Writer

from drpbench.geometry import BOX, FAR
from drpbench.policies import DcpRmp
from drpbench.robot import LINKS

from . import messages
from .clouds import clouds
from .episode import Episode, RecordingError, nanoseconds
from .events import at_goal, events, put_down
from .figure import arm_figure
from .motion import Motion, arm_at, motion
from .reaction import reaction

SELDOM = 6  # control steps between clouds, errors and reactions: 10 Hz
FRAMES = LINKS[:9]  # link0 to link7, hand
JOINTS = tuple(f"joint{i}" for i in range(1, 8))

OBSTACLE = (0.62, 0.66, 0.72)
MOVER = (0.24, 0.42, 0.86, 0.9)
CONTACT = (0.90, 0.10, 0.12)
GOAL = (0.98, 0.60, 0.10, 0.35)
MODIFIED = (0.60, 0.25, 0.85, 0.35)


@dataclass(frozen=True)
class _Message:
    time: int
    topic: str
    content: object


def write_mcap(
    path: Path,
    episode: Episode,
    about: Mapping[str, str],
    module: DcpRmp | None = None,
) -> None:
    """Writes the file whole or not at all; one that is there is replaced.

    `about` becomes the file's metadata `drpbench`. `module` is the DCP-RMP over the policy, if any: then
    its closest point and modified goal are recorded too. Raises RecordingError where the file cannot be
    written.
    """
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            with temporary.open("wb") as file:
                with Writer(file, compression=CompressionType.ZSTD) as writer:
                    writer.add_metadata("drpbench", dict(about))
                    for message in _messages(episode, module):
                        time = message.time
                        writer.write_message(message.topic, message.content, time, time)
                file.flush()
                os.fsync(file.fileno())
            os.replace(temporary, path)
        finally:
            temporary.unlink(missing_ok=True)
    except OSError as error:
        reason = (error.strerror or type(error).__name__).lower()
        raise RecordingError(f"{path}: cannot be written: {reason}") from None


def _messages(episode: Episode, module: DcpRmp | None) -> Iterator[_Message]:
    """Everything in the order of time."""
    moved = motion(episode)
    seldom = np.arange(0, episode.instants, SELDOM)
    by_instant: dict[int, list[_Message]] = {}
    for source in (
        _beginning(episode, moved),
        _happenings(episode, moved),
        _errors(moved, seldom),
        _clouds(episode, seldom),
        _reactions(episode, module, seldom) if module else (),
    ):
        for instant, topic, content in source:
            message = _Message(nanoseconds(instant), topic, content)
            by_instant.setdefault(instant, []).append(message)
    often = _Often(episode, moved)
    for instant in range(episode.instants):
        time = nanoseconds(instant)
        yield from by_instant.get(instant, ())
        yield from (_Message(time, *each) for each in often.at(instant, time))


class _Often:
    """What is written at every instant: poses, joints, clearance."""

    def __init__(self, episode: Episode, moved: Motion):
        boxes = episode.boxes
        names = [f"box{i}" for i in range(boxes.count)]
        self._transforms = messages.Transforms([*FRAMES, *names])
        self._joints = messages.Joints(JOINTS)
        places = np.concatenate([moved.link_position, boxes.position], axis=1)
        turns = np.concatenate([moved.link_quaternion, moved.mover_quaternion], axis=1)
        # One instant's numbers become Python's at a time: many lists at once wake the garbage collector.
        self._poses = np.concatenate([places, turns], axis=2).reshape(episode.instants, -1)
        joints = np.stack([episode.joint_position, episode.joint_velocity], axis=2)
        self._motion = joints.reshape(episode.instants, -1)
        self._clearance = moved.clearance if moved.clearance.min() < 0.5 * FAR else None

    def at(self, instant: int, time: int) -> Iterator[tuple[str, object]]:
        yield "/tf", self._transforms.at(time, self._poses[instant].tolist())
        yield "/joint_states", self._joints.at(time, self._motion[instant].tolist())
        if self._clearance is not None:
            yield "/clearance", DoubleValue(value=self._clearance[instant])


def _beginning(episode: Episode, moved: Motion) -> Iterator[tuple[int, str, object]]:
    """What stands still: the scene and the goal."""
    problem = episode.problem
    static = problem.obstacles
    turns = _quaternions(static.rotation)
    solids = [
        messages.obstacle(
            f"obstacle{k}",
            messages.WORLD,
            0,
            (int(static.kind[k]), static.half_size[k]),
            (static.position[k], turns[k]),
            OBSTACLE,
        )
        for k in np.flatnonzero(static.mask)
    ]
    yield 0, "/scene", messages.scene(solids)
    yield 0, "/goal/pose", messages.pose(0, problem.goal_position, problem.goal_quaternion)
    yield 0, "/goal/arm", messages.scene(_arm("goal", 0, color=GOAL))
    yield 0, "/tf_static", _arm_transforms("goal", 0, problem.goal)


def _happenings(episode: Episode, moved: Motion) -> Iterator[tuple[int, str, object]]:
    """What changes now and then: the boxes' shapes, the colour of a link in contact, the log."""
    boxes = episode.boxes
    new, active = put_down(episode), boxes.active
    changed = new.any(axis=1)
    changed[1:] |= (active[1:] != active[:-1]).any(axis=1)
    for instant in np.flatnonzero(changed).tolist():
        time = nanoseconds(instant)
        there = [
            messages.obstacle(
                f"box{i}", f"box{i}", time, (BOX, boxes.half_size[instant, i]), _HERE, MOVER
            )
            for i in np.flatnonzero(active[instant])
        ]
        gone = [f"box{i}" for i in np.flatnonzero(~active[instant])]
        yield instant, "/obstacles", messages.scene(there, gone, time)

    touched = np.where(moved.touching, moved.link, -1)
    for instant in np.flatnonzero(np.diff(touched, prepend=-2)).tolist():
        time, link = nanoseconds(instant), int(touched[instant])
        yield instant, "/arm", messages.scene(_arm("", time, red=min(link, 8)))
    for instant in np.flatnonzero(moved.touching).tolist():
        mark = messages.entity("contact", messages.WORLD, nanoseconds(instant))
        mark.lifetime.nanos = 10**8
        messages.add_solid(
            mark, "sphere", (0.02,) * 3, moved.contact_point[instant], _HERE[1], CONTACT
        )
        yield instant, "/contact", messages.scene([mark])

    for event in events(episode, moved):
        level = Log.ERROR if event.bad else Log.INFO
        time = nanoseconds(event.instant)
        yield event.instant, "/log", messages.log(time, event.text, level)
    last = episode.instants - 1
    end = "at the goal" if at_goal(moved)[last] else "not at the goal"
    verdict = (
        f"the end: {end}, {100 * moved.position_error[last]:.1f} cm and "
        f"{np.degrees(moved.orientation_error[last]):.0f} degrees from it; "
        f"{'collided' if moved.touching.any() else 'never collided'}"
    )
    yield last, "/log", messages.log(nanoseconds(last), verdict)


def _errors(moved: Motion, instants: np.ndarray) -> Iterator[tuple[int, str, object]]:
    for instant in instants.tolist():
        yield instant, "/position_error", DoubleValue(value=moved.position_error[instant])
        yield instant, "/orientation_error", DoubleValue(value=moved.orientation_error[instant])


def _clouds(episode: Episode, instants: np.ndarray) -> Iterator[tuple[int, str, object]]:
    """The static scene's points once, the moving boxes' and the arm's again and again."""
    seen = clouds(episode, instants)
    still, moving = slice(seen.static), slice(seen.static, None)
    cloud = messages.point_cloud(0, seen.scene[0, still][seen.mask[0, still]])
    yield 0, "/points/scene", cloud
    for n, instant in enumerate(instants.tolist()):
        time = nanoseconds(instant)
        yield instant, "/points/arm", messages.point_cloud(time, seen.robot[n])
        if episode.boxes.count:
            points = seen.scene[n, moving][seen.mask[n, moving]]
            yield instant, "/points/boxes", messages.point_cloud(time, points)


def _reactions(
    episode: Episode, module: DcpRmp, instants: np.ndarray
) -> Iterator[tuple[int, str, object]]:
    """The dynamic closest point and the modified goal, while there are any."""
    found, shown = reaction(module, episode, instants), False
    for n, instant in enumerate(instants.tolist()):
        time = nanoseconds(instant)
        if found.active[n] != shown:
            # Shown once: its frames carry it from then on.
            arm = [] if shown else _arm("modified", time, color=MODIFIED)
            gone = [_named("modified", frame) for frame in FRAMES] if shown else []
            yield instant, "/dcp_rmp/goal", messages.scene(arm, gone, time)
            if shown:
                yield instant, "/dcp_rmp/closest", messages.scene([], ["closest"], time)
            shown = not shown
        if not shown:
            continue
        ends = found.arm_point[n], found.obstacle_point[n]
        closest = messages.entity("closest", messages.WORLD, time)
        messages.add_line(closest, ends, 0.006, CONTACT)
        for end in ends:
            messages.add_solid(closest, "sphere", (0.012,) * 3, end, _HERE[1], CONTACT)
        yield instant, "/dcp_rmp/closest", messages.scene([closest])
        yield instant, "/tf", _arm_transforms("modified", time, found.goal_joints[n])


_HERE = ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0))


def _named(arm: str, frame: str) -> str:
    return f"{arm}/{frame}" if arm else frame


def _arm(arm: str, time: int, color: messages.Color | None = None, red: int = -1):
    """The arm's links as entities, in one colour or in their own; the frame `red` in contact's."""
    links = [messages.entity(_named(arm, f), _named(arm, f), time) for f in FRAMES]
    for solid in arm_figure():
        paint = CONTACT if solid.frame == red else color or solid.color
        messages.add_solid(
            links[solid.frame],
            solid.kind,
            solid.half_size,
            solid.position,
            solid.quaternion,
            paint,
        )
    return links


def _arm_transforms(arm: str, time: int, joints: np.ndarray):
    places, turns = arm_at(joints)
    transforms = messages.Transforms([_named(arm, frame) for frame in FRAMES])
    return transforms.at(time, np.concatenate([places, turns], axis=1).ravel().tolist())


def _quaternions(rotation: np.ndarray) -> np.ndarray:
    """Quaternions (K, 4) wxyz of rotation matrices (K, 3, 3)."""
    from scipy.spatial.transform import Rotation

    return Rotation.from_matrix(rotation).as_quat(scalar_first=True)
