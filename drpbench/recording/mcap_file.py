"""An episode as an MCAP file with Foxglove's schemas."""

import os
from collections.abc import Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from foxglove_schemas_protobuf.Log_pb2 import Log
from google.protobuf.wrappers_pb2 import DoubleValue

from drpbench.geometry import BOX, FAR
from drpbench.policies import DcpRmp
from drpbench.robot import PANDA

from . import container, messages
from .clouds import clouds
from .container import Messages
from .episode import Episode, RecordingError, nanoseconds
from .events import at_goal, events, put_down
from .figure import HAND, arm_figure
from .forms import ANY_TIME, Form, any_number, any_numbers, any_points
from .motion import Motion, arm_at, motion
from .reaction import reaction

SELDOM = 6  # control steps between clouds, errors and reactions: 10 Hz
TEMPORARY = ".*.mcap.tmp"
"""Names of files that are not finished."""
_CHUNK = 4 * 10**9  # [ns] about a megabyte
FRAMES = PANDA.link_names[:9]  # link0 to link7, hand
JOINTS = tuple(f"joint{i}" for i in range(1, 8))

OBSTACLE = (0.62, 0.66, 0.72)
MOVER = (0.24, 0.42, 0.86, 0.9)
CONTACT = (0.90, 0.10, 0.12)
GOAL = (0.98, 0.60, 0.10, 0.35)
MODIFIED = (0.60, 0.25, 0.85, 0.35)


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
    groups = list(_messages(episode, module))
    temporary = path.with_name(TEMPORARY.replace("*", f"{path.stem}.{os.getpid()}"))
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            with temporary.open("wb") as file:
                container.write(file, groups, {"drpbench": about}, _CHUNK)
                file.flush()
                os.fsync(file.fileno())
            os.replace(temporary, path)
        finally:
            temporary.unlink(missing_ok=True)
    except OSError as error:
        reason = (error.strerror or type(error).__name__).lower()
        raise RecordingError(f"{path}: cannot be written: {reason}") from None


def _messages(episode: Episode, module: DcpRmp | None) -> Iterator[Messages]:
    """Everything; what is of the same time in the order in which it is to be read."""
    moved = motion(episode)
    seldom = np.arange(0, episode.instants, SELDOM)
    yield from _beginning(episode)
    yield from _happenings(episode, moved)
    yield from _errors(moved, seldom)
    yield from _clouds(episode, seldom)
    if module:
        yield from _reactions(episode, module, seldom)
    yield from _often(episode, moved)


def _one(instant: int, topic: str, message: Any) -> Messages:
    content = np.frombuffer(message.SerializeToString(), np.uint8)[None]
    return Messages(topic, type(message), np.array([nanoseconds(instant)]), content)


def _many(
    instants: np.ndarray,
    topic: str,
    form: Form,
    numbers: np.ndarray | None = None,
    points: np.ndarray | None = None,
) -> Messages:
    times = nanoseconds(np.asarray(instants, np.int64))
    return Messages(topic, form.schema, times, form.fill(times, numbers, points))


def _often(episode: Episode, moved: Motion) -> Iterator[Messages]:
    """What is written at every instant: poses, joints, clearance."""
    every, boxes = np.arange(episode.instants), episode.boxes
    places = np.concatenate([moved.link_position, boxes.position], axis=1)
    turns = np.concatenate([moved.link_quaternion, moved.mover_quaternion], axis=1)
    frames = (*FRAMES, *(f"box{i}" for i in range(boxes.count)))
    yield _many(every, "/tf", _transforms(frames), _flat(places, turns))
    joints = np.stack([episode.joint_position, episode.joint_velocity], axis=2)
    yield _many(every, "/joint_states", _joint_states(), joints.reshape(episode.instants, -1))
    if moved.clearance.min() < 0.5 * FAR:
        yield _many(every, "/clearance", _number(), moved.clearance[:, None])


def _beginning(episode: Episode) -> Iterator[Messages]:
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
    yield _one(0, "/scene", messages.scene(solids))
    pose = messages.pose(0, problem.goal_position, problem.goal_quaternion)
    yield _one(0, "/goal/pose", pose)
    start = np.zeros(1, int)
    yield _many(start, "/goal/arm", _arm("goal", GOAL))
    ghost = _transforms(_named("goal"))
    yield _many(start, "/tf_static", ghost, _flat(*arm_at(problem.goal[None])))


def _happenings(episode: Episode, moved: Motion) -> Iterator[Messages]:
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
        yield _one(instant, "/obstacles", messages.scene(there, gone, time))

    red = np.where(moved.touching, np.minimum(moved.link, HAND), -1)
    changed = np.diff(np.where(moved.touching, moved.link, -1), prepend=-2) != 0
    for frame in np.unique(red[changed]).tolist():
        yield _many(np.flatnonzero(changed & (red == frame)), "/arm", _arm("", None, frame))
    touching = np.flatnonzero(moved.touching)
    if len(touching):
        yield _many(touching, "/contact", _contact(), moved.contact_point[touching])

    for event in events(episode, moved):
        level = Log.ERROR if event.bad else Log.INFO
        time = nanoseconds(event.instant)
        yield _one(event.instant, "/log", messages.log(time, event.text, level))
    last = episode.instants - 1
    end = "at the goal" if at_goal(moved)[last] else "not at the goal"
    verdict = (
        f"the end: {end}, {100 * moved.position_error[last]:.1f} cm and "
        f"{np.degrees(moved.orientation_error[last]):.0f} degrees from it; "
        f"{'collided' if moved.touching.any() else 'never collided'}"
    )
    yield _one(last, "/log", messages.log(nanoseconds(last), verdict))


def _errors(moved: Motion, instants: np.ndarray) -> Iterator[Messages]:
    for topic, error in (
        ("/position_error", moved.position_error),
        ("/orientation_error", moved.orientation_error),
    ):
        yield _many(instants, topic, _number(), error[instants, None])


def _clouds(episode: Episode, instants: np.ndarray) -> Iterator[Messages]:
    """The static scene's points once, the moving boxes' and the arm's again and again."""
    seen = clouds(episode, instants)
    still = messages.point_cloud(0, seen.static[seen.static_mask])
    yield _one(0, "/points/scene", still)
    yield _cloud_of(instants, "/points/arm", seen.robot)
    if episode.boxes.count:
        # Messages of one length: instants with as many points above the floor.
        counts = seen.boxes_mask.sum(axis=1)
        for count in np.unique(counts):
            same = counts == count
            points, there = seen.boxes[same], seen.boxes_mask[same]
            if count < there.shape[1]:
                points = points[there].reshape(len(there), count, 3)
            yield _cloud_of(instants[same], "/points/boxes", points)


def _reactions(episode: Episode, module: DcpRmp, instants: np.ndarray) -> Iterator[Messages]:
    """The dynamic closest point and the modified goal, while there are any."""
    found = reaction(module, episode, instants)
    turned = np.diff(found.active, prepend=False)
    # Shown once: its frames carry it from then on.
    yield _many(instants[turned & found.active], "/dcp_rmp/goal", _arm("modified", MODIFIED))
    ended = instants[turned & ~found.active]
    yield _many(ended, "/dcp_rmp/goal", _gone(_named("modified")))
    yield _many(ended, "/dcp_rmp/closest", _gone(("closest",)))
    shown = np.flatnonzero(found.active)
    ends = np.concatenate([found.arm_point, found.obstacle_point], axis=1)
    yield _many(instants[shown], "/dcp_rmp/closest", _closest(), ends[shown])
    poses = _flat(*arm_at(found.goal_joints))
    yield _many(instants[shown], "/tf", _transforms(_named("modified")), poses[shown])


_HERE = ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0))


def _named(arm: str) -> tuple[str, ...]:
    """The frames of an arm that is not the arm."""
    return tuple(f"{arm}/{frame}" if arm else frame for frame in FRAMES)


def _flat(positions: np.ndarray, quaternions: np.ndarray) -> np.ndarray:
    """Poses (N, 7 F) as `_transforms` takes them, of positions (N, F, 3) and quaternions (N, F, 4)."""
    return np.concatenate([positions, quaternions], axis=2).reshape(len(positions), -1)


@cache
def _transforms(frames: tuple[str, ...]) -> Form:
    count = 7 * len(frames)
    return Form(messages.transforms(ANY_TIME, frames, any_numbers(count)), numbers=count)


@cache
def _joint_states() -> Form:
    return Form(messages.joints(ANY_TIME, JOINTS, any_numbers(14)), numbers=14)


@cache
def _number() -> Form:
    return Form(DoubleValue(value=any_number(0)), numbers=1)


@cache
def _arm(arm: str, color: messages.Color | None, red: int = -1) -> Form:
    """The arm's links as entities, in one colour or in their own; the frame `red` in contact's."""
    links = [messages.entity(name, name, ANY_TIME) for name in _named(arm)]
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
    return Form(messages.scene(links))


@cache
def _gone(names: tuple[str, ...]) -> Form:
    return Form(messages.scene([], names, ANY_TIME))


@cache
def _contact() -> Form:
    mark = messages.entity("contact", messages.WORLD, ANY_TIME)
    mark.lifetime.nanos = 10**8
    messages.add_solid(mark, "sphere", (0.02,) * 3, any_numbers(3), _HERE[1], CONTACT)
    return Form(messages.scene([mark]), numbers=3)


@cache
def _closest() -> Form:
    """A line with a ball at each end."""
    closest = messages.entity("closest", messages.WORLD, ANY_TIME)
    ends = any_numbers(3), any_numbers(3, first=3)
    messages.add_line(closest, ends, 0.006, CONTACT)
    for end in ends:
        messages.add_solid(closest, "sphere", (0.012,) * 3, end, _HERE[1], CONTACT)
    return Form(messages.scene([closest]), numbers=6)


def _cloud_of(instants: np.ndarray, topic: str, points: np.ndarray) -> Messages:
    """Points (N, P, 3)."""
    count = points.shape[1]
    form = Form(messages.point_cloud(ANY_TIME, any_points(count)), points=count)
    return _many(instants, topic, form, points=points)


def _quaternions(rotation: np.ndarray) -> np.ndarray:
    """Quaternions (K, 4) wxyz of rotation matrices (K, 3, 3)."""
    from scipy.spatial.transform import Rotation

    return Rotation.from_matrix(rotation).as_quat(scalar_first=True)
