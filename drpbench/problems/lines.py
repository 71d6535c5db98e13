"""Problem sets as text, JSON lines: what other tools write and read.

The first line is the set's header, each further one a problem:

    {"format": "drpbench-problems-1", "name": "mine", "arm": "panda", "finger_opening": 0.04,
     "ground": true, "tasks": ["FDO"]}
    {"id": 0, "task": "FDO", "start": [...], "goal": [...], "obstacles": [
     {"shape": "box", "size": [1.8, 2.0, 0.05], "position": [0.4, 0.0, -0.025]}]}

(each on one line). docs/problems.md describes the fields. Numbers are the shortest that give back
the stored float32, so writing and reading are inverse to the bit.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from drpbench.errors import DrpbenchError
from drpbench.geometry import CYLINDER, SHAPES, Obstacles, stacked
from drpbench.robot import Robot, arm

from .goal_poses import goal_poses
from .problem_set import ProblemSet
from .task_problems import ProblemSetError, TaskProblems

if TYPE_CHECKING:
    from .goal_joints import GoalJoints

FORMAT = "drpbench-problems-1"
_HEADER = ("format", "name", "arm", "finger_opening", "ground", "tasks")
_PROBLEM = (
    *("id", "task", "family", "pair", "level", "start", "goal"),
    *("goal_position", "goal_quaternion", "obstacles", "witness"),
)
_SIZES = {"box": ("size",), "cylinder": ("radius", "height"), "sphere": ("radius",)}
_UNIT = 1e-3  # how far a quaternion's length may be from 1


def export_lines(problem_set: ProblemSet, tasks: Sequence[str] | None = None) -> Iterator[str]:
    """The lines of a file that `read_lines` reads back: the header, and the problems of `tasks`.

    With all of its tasks (None) the set keeps its name; else the tasks are added to it.
    """
    tasks = problem_set.tasks if tasks is None else tuple(tasks)
    own = set(tasks) == set(problem_set.tasks)
    name = problem_set.name if own else "-".join([problem_set.name, *tasks])
    yield header_line(name, tasks, problem_set.arm, problem_set.finger_opening, problem_set.ground)
    for task in tasks:
        problems = problem_set.task(task)
        for id in range(problems.count):
            yield json.dumps(to_json(problems, id))


def header_line(
    name: str,
    tasks: Sequence[str],
    arm: str = "panda",
    finger_opening: float = 0.04,
    ground: bool = True,
) -> str:
    """The first line of a set's file; `finger_opening` [m]."""
    values = (FORMAT, name, arm, finger_opening, ground, list(tasks))
    return json.dumps(dict(zip(_HEADER, values, strict=True)))


def to_json(problems: TaskProblems, id: int) -> dict[str, Any]:
    """One problem as plain values. Raises ProblemSetError for a number that there is not."""
    problems.require([id])
    there = problems.obstacles[id].present()
    obstacles = [
        _obstacle(SHAPES[kind], half_size, position, quaternion)
        for kind, half_size, position, quaternion in zip(
            there.kind, there.half_size, there.position, there.quaternion, strict=True
        )
    ]
    return {
        "id": id,
        "task": problems.task,
        "family": problems.family[id],
        "pair": problems.pair[id],
        "level": int(problems.level[id]),
        "start": _plain(problems.start[id]),
        "goal": _plain(problems.goal[id]),
        "goal_position": _plain(problems.goal_position[id]),
        "goal_quaternion": _plain(problems.goal_quaternion[id]),
        "obstacles": obstacles,
        "witness": [_plain(q) for q in problems.witness[id]],
    }


def _plain(values: np.ndarray) -> list[float]:
    """Shortest decimals that read back as the same float32."""
    return [float(str(value)) for value in values.astype(np.float32)]


def _obstacle(
    shape: str, half_size: np.ndarray, position: np.ndarray, quaternion: np.ndarray
) -> dict[str, Any]:
    """Full extents of a box, radius and height of the others."""
    full, radius = _plain(2 * half_size), _plain(half_size)[0]
    sizes = {"size": full, "radius": radius, "height": full[2]}
    return {
        "shape": shape,
        **{name: sizes[name] for name in _SIZES[shape]},
        "position": _plain(position),
        "quaternion": _plain(quaternion),
    }


class _Fault(Exception):
    """What is wrong with a line."""


def read_lines(path: Path) -> ProblemSet:
    """The set in a file. Raises ProblemSetError, naming file and line, where it is not as it should
    be."""
    try:
        content = path.read_bytes()
        lines = content.decode().splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise ProblemSetError(f"{path}: cannot be read as text ({error})") from None
    number, joints = 1, None
    try:
        header = _header(_parsed(lines[0] if lines else ""))
        robot = arm(header["arm"], header["finger_opening"])
        problems: dict[str, list[dict[str, Any]]] = {task: [] for task in header["tasks"]}
        for line in lines[1:]:
            number += 1
            problem = _problem(_parsed(line), robot, problems)
            if "goal" not in problem:
                from .goal_joints import GoalJoints  # MuJoCo, which few sets need

                joints = joints or GoalJoints(robot)
                problem["goal"] = _reaching(problem, joints)
            problems[problem["task"]].append(problem)
        if empty := [task for task, found in problems.items() if not found]:
            raise _Fault(f"the file ends without a problem of task {empty[0]}")
    except (_Fault, DrpbenchError) as fault:
        raise ProblemSetError(f"{path}: line {number}: {fault}") from None
    return ProblemSet(
        name=header["name"],
        sha256=hashlib.sha256(content).hexdigest(),
        problems={task: _together(task, found, robot) for task, found in problems.items()},
        arm=header["arm"],
        finger_opening=header["finger_opening"],
        ground=header["ground"],
    )


def _parsed(line: str) -> dict[str, Any]:
    try:
        values = json.loads(line)
    except ValueError:
        raise _Fault("expected one JSON object") from None
    if not isinstance(values, dict):
        raise _Fault(f"expected a JSON object, got {type(values).__name__}")
    return values


def _known(values: Mapping[str, Any], names: Sequence[str], where: str) -> None:
    if unknown := [name for name in values if name not in names]:
        raise _Fault(f"{where} has no field {unknown[0]!r}; its fields are {', '.join(names)}")


def _header(values: dict[str, Any]) -> dict[str, Any]:
    """The header's fields, with what is usual for those left out."""
    if values.get("format") != FORMAT:
        raise _Fault(f'expected the header, with "format": "{FORMAT}"')
    _known(values, _HEADER, "the header")
    header: dict[str, Any] = {"arm": "panda", "finger_opening": 0.04, "ground": True, **values}
    opening, tasks = header["finger_opening"], header.get("tasks")
    if not isinstance(header.get("name"), str) or not header["name"].strip():
        raise _Fault("name: expected the set's name")
    if not isinstance(header["arm"], str):
        raise _Fault("arm: expected an arm's name, such as panda")
    if isinstance(opening, bool) or not isinstance(opening, (int, float)) or not 0 <= opening < 1:
        raise _Fault("finger_opening: expected metres, such as 0.04")
    if not isinstance(header["ground"], bool):
        raise _Fault("ground: expected true or false")
    if not isinstance(tasks, list) or not tasks or not all(isinstance(t, str) for t in tasks):
        raise _Fault('tasks: expected a list of names, such as ["SE"]')
    if len(set(tasks)) < len(tasks):
        raise _Fault("tasks: a task is named twice")
    return header | {"finger_opening": float(opening)}


def _problem(
    values: dict[str, Any], robot: Robot, problems: Mapping[str, Sequence[Any]]
) -> dict[str, Any]:
    """The fields of one problem as arrays; absent: those that may be."""
    _known(values, _PROBLEM, "a problem")
    task = values.get("task")
    if not isinstance(task, str) or task not in problems:
        raise _Fault(f"task: expected one of the header's ({', '.join(problems)}), got {task!r}")
    number, joints = len(problems[task]), robot.joints
    if values.get("id", number) != number:
        raise _Fault(f"id: expected {number}, the next of {task}, got {values['id']!r}")
    found: dict[str, Any] = {"task": task}
    pose = ("goal_position" in values, "goal_quaternion" in values)
    if any(pose) and not all(pose):
        raise _Fault("expected goal_position and goal_quaternion together, or neither")
    for name in ("start",) if all(pose) and "goal" not in values else ("start", "goal"):
        found[name] = _numbers(values, name, (joints,))
        lower, upper = robot.joint_lower.astype(np.float32), robot.joint_upper.astype(np.float32)
        for joint in np.flatnonzero((found[name] < lower) | (found[name] > upper)):
            raise _Fault(
                f"{name}: joint {joint + 1} is {found[name][joint]:g} rad, "
                f"beyond its limits of {lower[joint]:g} and {upper[joint]:g}"
            )
    if all(pose):
        found["goal_position"] = _numbers(values, "goal_position", (3,))
        found["goal_quaternion"] = _quaternion(values, "goal_quaternion")
    for name, usual in (("family", "any"), ("pair", "")):
        found[name] = values.get(name, usual)
        if not isinstance(found[name], str) or (usual and not found[name]):
            raise _Fault(f"{name}: expected a word, got {found[name]!r}")
    found["level"] = values.get("level", 0)
    if not isinstance(found["level"], int) or isinstance(found["level"], bool):
        raise _Fault(f"level: expected a whole number, got {found['level']!r}")
    obstacles = values.get("obstacles")
    if not isinstance(obstacles, list):
        raise _Fault("obstacles: expected a list")
    found["obstacles"] = scene_of(obstacles)
    if values.get("witness"):
        found["witness"] = _numbers(values, "witness", (len(values["witness"]), joints))
    else:
        found["witness"] = np.zeros((0, joints), np.float32)
    return found


def _reaching(problem: dict[str, Any], joints: GoalJoints) -> np.ndarray:
    """Joints that reach the pose that is given instead of them."""
    wanted = problem["goal_position"], problem["goal_quaternion"], problem["obstacles"]
    found = joints.nearest(problem["start"], *wanted)
    if found is None:
        raise _Fault("no joints that touch nothing were found for the pose; give the goal's joints")
    return found


def scene_of(obstacles: Sequence[Any]) -> Obstacles:
    """Obstacles as a problem's line has them. Raises a fault of the line."""
    rows = []
    for index, values in enumerate(obstacles):
        try:
            rows.append(_read_obstacle(values))
        except _Fault as fault:
            raise _Fault(f"obstacle {index}: {fault}") from None
    if not rows:
        return Obstacles.absent(0)
    kind, half_size, position, quaternion = zip(*rows, strict=True)
    return Obstacles.of(
        np.array(kind, np.int32), np.stack(half_size), np.stack(position), np.stack(quaternion)
    )


def _read_obstacle(values: Any) -> tuple[int, np.ndarray, np.ndarray, np.ndarray]:
    """Kind, half size, position and quaternion."""
    shape = values.get("shape") if isinstance(values, dict) else None
    if shape not in _SIZES:
        raise _Fault(f"expected a shape ({', '.join(SHAPES)}), got {shape!r}")
    _known(values, ("shape", *_SIZES[shape], "position", "quaternion"), f"a {shape}")
    kind = SHAPES.index(shape)
    if shape == "box":
        half_size = _numbers(values, "size", (3,)) / 2
    else:
        radius = _numbers(values, "radius", ())
        height = _numbers(values, "height", ()) / 2 if kind == CYLINDER else radius
        half_size = np.array([radius, radius, height], np.float32)
    if not np.all(half_size > 0.0):
        raise _Fault(f"a {shape}'s sizes must be above 0")
    turned = "quaternion" in values
    quaternion = _quaternion(values, "quaternion") if turned else np.array([1, 0, 0, 0], np.float32)
    return kind, half_size, _numbers(values, "position", (3,)), quaternion


def _numbers(values: Mapping[str, Any], name: str, shape: tuple[int, ...]) -> np.ndarray:
    """A field as a float32 array of this shape."""
    try:
        found = np.array(values[name])
        if found.shape != shape or found.dtype.kind not in "if":
            raise ValueError
        found = found.astype(np.float32)
        if not np.isfinite(found).all():
            raise ValueError
    except (KeyError, ValueError, OverflowError):
        size = " x ".join(map(str, shape))
        expected = f"{size} finite numbers" if shape else "a finite number"
        got = "a wrong value" if name in values else "nothing"
        raise _Fault(f"{name}: expected {expected}, got {got}") from None
    return found


def _quaternion(values: Mapping[str, Any], name: str) -> np.ndarray:
    found = _numbers(values, name, (4,))
    if abs(float(np.linalg.norm(found)) - 1.0) > _UNIT:
        raise _Fault(f"{name}: expected a unit quaternion (w, x, y, z)")
    return found


def _together(task: str, problems: Sequence[dict[str, Any]], robot: Robot) -> TaskProblems:
    width = max(problem["obstacles"].count for problem in problems)
    goal = np.stack([problem["goal"] for problem in problems])
    position, quaternion = _goal_poses(problems, goal, robot)
    return TaskProblems(
        task=task,
        obstacles=stacked([problem["obstacles"].padded(width) for problem in problems]),
        start=np.stack([problem["start"] for problem in problems]),
        goal=goal,
        goal_position=position,
        goal_quaternion=quaternion,
        family=[problem["family"] for problem in problems],
        pair=[problem["pair"] for problem in problems],
        level=np.array([problem["level"] for problem in problems], np.int32),
        witness=[problem["witness"] for problem in problems],
    )


def _goal_poses(
    problems: Sequence[dict[str, Any]], goal: np.ndarray, robot: Robot
) -> tuple[np.ndarray, np.ndarray]:
    """Goal positions (n, 3) and quaternions (n, 4): those that are given, the others from the
    joints."""
    given = np.array(["goal_position" in problem for problem in problems])
    position = np.zeros((len(problems), 3), np.float32)
    quaternion = np.zeros((len(problems), 4), np.float32)
    if not given.all():
        position[~given], quaternion[~given] = goal_poses(robot, goal[~given])
    for index, problem in enumerate(problems):
        if given[index]:
            position[index] = problem["goal_position"]
            quaternion[index] = problem["goal_quaternion"]
    return position, quaternion
