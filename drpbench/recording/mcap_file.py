"""An episode as an MCAP file with Foxglove's schemas."""

import os
from collections.abc import Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import Any

import jax
import numpy as np
from foxglove_schemas_protobuf.Log_pb2 import Log
from google.protobuf.wrappers_pb2 import DoubleValue

from drpbench.geometry import BOX, FAR
from drpbench.policies import DcpRmp
from drpbench.robot import Robot

from . import container, messages
from .clouds import clouds
from .container import Messages
from .episode import Recording, RecordingError
from .events import events, put_down
from .forms import ANY_TIME, Form, any_number, any_numbers, any_points
from .motion import Motion, arm_at, motion
from .reaction import reaction

SELDOM = 6  # control steps between clouds, errors and reactions: 10 Hz
TEMPORARY = ".*.mcap.tmp"
"""Names of files that are not finished."""
_CHUNK = 4 * 10**9  # [ns] about a megabyte
_POSE = 7  # numbers of a pose: position and quaternion

OBSTACLE = (0.62, 0.66, 0.72)
MOVER = (0.24, 0.42, 0.86, 0.9)
CONTACT = (0.90, 0.10, 0.12)
GOAL = (0.98, 0.60, 0.10, 0.35)
MODIFIED = (0.60, 0.25, 0.85, 0.35)


def write_mcap(
    path: Path,
    episode: Recording,
    about: Mapping[str, str],
    module: DcpRmp | None = None,
) -> None:
    """Writes the file whole or not at all; one that is there is replaced.

    `about` becomes the file's metadata `drpbench`. `module` is the DCP-RMP over the policy, if any:
    then its closest point and modified goal are recorded too. Raises RecordingError where the file
    cannot be written.
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


def _messages(episode: Recording, module: DcpRmp | None) -> Iterator[Messages]:
    """Everything; what is of the same time in the order in which it is to be read."""
    moved = motion(episode)
    seldom = np.arange(0, episode.instants, SELDOM)
    yield from _beginning(episode)
    yield from _happenings(episode, moved)
    yield from _errors(episode, moved, seldom)
    yield from _clouds(episode, seldom)
    if module:
        yield from _reactions(episode, module, seldom)
    yield from _often(episode, moved)


def _one(episode: Recording, instant: int, topic: str, message: Any) -> Messages:
    content = np.frombuffer(message.SerializeToString(), np.uint8)[None]
    return Messages(topic, type(message), np.array([episode.time(instant)]), content)


def _many(
    episode: Recording,
    instants: np.ndarray,
    topic: str,
    form: Form,
    numbers: np.ndarray | None = None,
    points: np.ndarray | None = None,
) -> Messages:
    times = episode.time(np.asarray(instants, np.int64))
    return Messages(topic, form.schema, times, form.fill(times, numbers, points))


def _often(episode: Recording, moved: Motion) -> Iterator[Messages]:
    """What is written at every instant: poses, joints, clearance."""
    every, boxes, robot = np.arange(episode.instants), episode.boxes, episode.world.robot
    places = np.concatenate([moved.link_position, boxes.position], axis=1)
    turns = np.concatenate([moved.link_quaternion, moved.mover_quaternion], axis=1)
    frames = (*robot.frame_names, *(f"box{i}" for i in range(boxes.count)))
    yield _many(episode, every, "/tf", _transforms(frames), _flat(places, turns))
    joints = np.stack([episode.joint_position, episode.joint_velocity], axis=2)
    yield _many(
        episode,
        every,
        "/joint_states",
        _joint_states(robot.joints),
        joints.reshape(episode.instants, -1),
    )
    if moved.clearance.min() < 0.5 * FAR:
        yield _many(episode, every, "/clearance", _number(), moved.clearance[:, None])


def _beginning(episode: Recording) -> Iterator[Messages]:
    """What stands still: the scene and the goal."""
    problem, robot = episode.problem, episode.world.robot
    static = jax.tree.map(np.asarray, problem.obstacles)
    goal = np.asarray(problem.goal)
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
    yield _one(episode, 0, "/scene", messages.scene(solids))
    pose = messages.pose(0, np.asarray(problem.goal_position), np.asarray(problem.goal_quaternion))
    yield _one(episode, 0, "/goal/pose", pose)
    start = np.zeros(1, int)
    yield _many(episode, start, "/goal/arm", _arm(robot, "goal", GOAL))
    ghost = _transforms(_named(robot, "goal"))
    yield _many(episode, start, "/tf_static", ghost, _flat(*arm_at(robot, goal[None])))


def _happenings(episode: Recording, moved: Motion) -> Iterator[Messages]:
    """What changes now and then: the boxes' shapes, the colour of a link in contact, the log."""
    boxes, robot = episode.boxes, episode.world.robot
    new, active = put_down(episode), boxes.active
    changed = np.array(new.any(axis=1))
    changed[1:] |= (active[1:] != active[:-1]).any(axis=1)
    for instant in np.flatnonzero(changed).tolist():
        time = episode.time(instant)
        there = [
            messages.obstacle(
                f"box{i}", f"box{i}", time, (BOX, boxes.half_size[instant, i]), _HERE, MOVER
            )
            for i in np.flatnonzero(active[instant])
        ]
        gone = [f"box{i}" for i in np.flatnonzero(~active[instant])]
        yield _one(episode, instant, "/obstacles", messages.scene(there, gone, time))

    frame_of = np.array([link.frame for link in robot.links])
    red = np.where(moved.touching, frame_of[moved.link], -1)
    changed = np.diff(np.where(moved.touching, moved.link, -1), prepend=-2) != 0
    for frame in np.unique(red[changed]).tolist():
        yield _many(
            episode, np.flatnonzero(changed & (red == frame)), "/arm", _arm(robot, "", None, frame)
        )
    touching = np.flatnonzero(moved.touching)
    if len(touching):
        yield _many(episode, touching, "/contact", _contact(), moved.contact_point[touching])

    for event in events(episode, moved):
        level = Log.ERROR if event.bad else Log.INFO
        time = episode.time(event.instant)
        yield _one(episode, event.instant, "/log", messages.log(time, event.text, level))
    last = episode.instants - 1
    end = "at the goal" if moved.at_goal[last] else "not at the goal"
    verdict = (
        f"the end: {end}, {100 * moved.position_error[last]:.1f} cm and "
        f"{np.degrees(moved.orientation_error[last]):.0f} degrees from it; "
        f"{'collided' if moved.touching.any() else 'never collided'}"
    )
    yield _one(episode, last, "/log", messages.log(episode.time(last), verdict))


def _errors(episode: Recording, moved: Motion, instants: np.ndarray) -> Iterator[Messages]:
    for topic, error in (
        ("/position_error", moved.position_error),
        ("/orientation_error", moved.orientation_error),
    ):
        yield _many(episode, instants, topic, _number(), error[instants, None])


def _clouds(episode: Recording, instants: np.ndarray) -> Iterator[Messages]:
    """The static scene's points once, the moving boxes' and the arm's again and again."""
    seen = clouds(episode, instants)
    still = messages.point_cloud(0, seen.static[seen.static_mask])
    yield _one(episode, 0, "/points/scene", still)
    yield _cloud_of(episode, instants, "/points/arm", seen.robot)
    if episode.boxes.count:
        # Messages of one length: instants with as many points above the floor.
        counts = seen.boxes_mask.sum(axis=1)
        for count in np.unique(counts):
            same = counts == count
            points, there = seen.boxes[same], seen.boxes_mask[same]
            if count < there.shape[1]:
                points = points[there].reshape(len(there), count, 3)
            yield _cloud_of(episode, instants[same], "/points/boxes", points)


def _reactions(episode: Recording, module: DcpRmp, instants: np.ndarray) -> Iterator[Messages]:
    """The dynamic closest point and the modified goal, while there are any."""
    found, robot = reaction(module, episode, instants), episode.world.robot
    turned = np.diff(found.active, prepend=False)
    # Shown once: its frames carry it from then on.
    yield _many(
        episode, instants[turned & found.active], "/dcp_rmp/goal", _arm(robot, "modified", MODIFIED)
    )
    ended = instants[turned & ~found.active]
    yield _many(episode, ended, "/dcp_rmp/goal", _gone(_named(robot, "modified")))
    yield _many(episode, ended, "/dcp_rmp/closest", _gone(("closest",)))
    shown = np.flatnonzero(found.active)
    ends = np.concatenate([found.arm_point, found.obstacle_point], axis=1)
    yield _many(episode, instants[shown], "/dcp_rmp/closest", _closest(), ends[shown])
    poses = _flat(*arm_at(robot, np.asarray(found.goal_joints)))
    yield _many(
        episode, instants[shown], "/tf", _transforms(_named(robot, "modified")), poses[shown]
    )


_HERE = ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0))


def _named(robot: Robot, arm: str) -> tuple[str, ...]:
    """The frames of the arm, or of another one that is shown beside it."""
    return tuple(f"{arm}/{frame}" if arm else frame for frame in robot.frame_names)


def _flat(positions: np.ndarray, quaternions: np.ndarray) -> np.ndarray:
    """Poses (N, _POSE F) as `_transforms` takes them, of positions (N, F, 3) and quaternions (N, F,
    4)."""
    return np.concatenate([positions, quaternions], axis=2).reshape(len(positions), -1)


@cache
def _transforms(frames: tuple[str, ...]) -> Form:
    count = _POSE * len(frames)
    return Form(messages.transforms(ANY_TIME, frames, any_numbers(count)), numbers=count)


@cache
def _joint_states(joints: int) -> Form:
    names = [f"joint{i}" for i in range(1, joints + 1)]
    return Form(messages.joints(ANY_TIME, names, any_numbers(2 * joints)), numbers=2 * joints)


@cache
def _number() -> Form:
    return Form(DoubleValue(value=any_number(0)), numbers=1)


@cache
def _arm(robot: Robot, arm: str, color: messages.Color | None, red: int = -1) -> Form:
    """The arm's links as entities, in one colour or in their own; the frame `red` in contact's."""
    links = [messages.entity(name, name, ANY_TIME) for name in _named(robot, arm)]
    for solid in robot.solids:
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


def _cloud_of(episode: Recording, instants: np.ndarray, topic: str, points: np.ndarray) -> Messages:
    """Points (N, P, 3)."""
    count = points.shape[1]
    form = Form(messages.point_cloud(ANY_TIME, any_points(count)), points=count)
    return _many(episode, instants, topic, form, points=points)


def _quaternions(rotation: np.ndarray) -> np.ndarray:
    """Quaternions (K, 4) wxyz of rotation matrices (K, 3, 3)."""
    from scipy.spatial.transform import Rotation

    return Rotation.from_matrix(rotation).as_quat(scalar_first=True)
