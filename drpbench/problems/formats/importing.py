"""Another project's problems as a set of one's own: a file of JSON lines."""

import hashlib
import json
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from drpbench.planning.checker import Checker, sphere_checker
from drpbench.problems.lines import header_line, scene_of
from drpbench.robot import Robot
from drpbench.robot.arms import arm as arm_of

from .moveit import read_moveit
from .problem import FormatError, OtherProblem
from .robometrics import read_robometrics

KNOWN = {
    "5165ad4f": "robometrics-motion-bench-maker",
    "9189186d": "robometrics-mpinets",
}
"""Published files, by the first bytes of their SHA-256."""


@dataclass(frozen=True)
class Imported:
    """What came of an import."""

    name: str
    lines: list[str]
    """Of the set's file."""
    families: Counter[str] = field(default_factory=Counter)
    """Problems of each family that were taken over."""
    left_out: Counter[str] = field(default_factory=Counter)
    """Problems that were not, by the reason."""
    touching: int = 0
    """Of those taken over, how many goals touch something by the collision spheres."""


def import_problems(
    path: Path,
    name: str | None = None,
    arm: str = "panda",
    finger_opening: float | None = None,
    ground: bool = False,
) -> Imported:
    """The problems of a folder of MoveIt's scenes and requests, or of a file of robometrics'.

    Of several goals the free one nearest to the start is kept. Raises FormatError, and
    DrpbenchError for an arm that there is not.
    """
    if path.is_dir():
        kind = "moveit"
    elif path.suffix in (".yaml", ".yml"):
        kind = "robometrics"
    elif path.suffix in (".pkl", ".pickle"):
        raise FormatError(
            f"{path}: pickles are not read, for they can run code; robometrics' YAML has the same "
            "problems"
        )
    else:
        raise FormatError(
            f"{path}: expected a folder of MoveIt's scene and request YAML, or robometrics' YAML"
        )
    read = read_moveit if kind == "moveit" else read_robometrics
    every = list(read(path, arm, arm_of(arm).joints))
    openings = {one.finger_opening for one in every}
    if finger_opening is None and len(openings) > 1:
        raise FormatError(
            f"{path}: the fingers are {sorted(openings)} m open; a set has one opening: name it "
            "with --finger-opening"
        )
    opening = min(openings, default=0.0) if finger_opening is None else finger_opening
    robot = arm_of(arm, opening)
    found = Imported(name or _name(path), [])
    spheres = sphere_checker(robot=robot)
    touching = 0
    for one in every:
        values = _taken(one, robot, spheres)
        if isinstance(values, str):
            found.left_out[values] += 1
            continue
        problem, free = values
        touching += not free
        found.families[one.family] += 1
        found.lines.append(json.dumps(problem))
    if not found.lines:
        raise FormatError(f"{path}: no problem of it can be taken over: {_told(found.left_out)}")
    header = header_line(found.name, ["SE"], arm, opening, ground)
    return Imported(found.name, [header, *found.lines], found.families, found.left_out, touching)


def _told(reasons: Counter[str]) -> str:
    return ", ".join(f"{count} {reason}" for reason, count in reasons.items()) or "there is none"


def _name(path: Path) -> str:
    if path.is_file():
        digest = hashlib.sha256(path.read_bytes()).hexdigest()
        return next((name for start, name in KNOWN.items() if digest.startswith(start)), path.stem)
    return f"moveit-{path.resolve().name}"


def _taken(one: OtherProblem, robot: Robot, spheres: Checker) -> tuple[dict[str, Any], bool] | str:
    """The problem as a line has it, and whether its goal is free; or why it is left out."""
    if one.infeasible:
        return "infeasible by their own set"
    within = [goal for goal in one.goals if _within(goal, robot)]
    if not _within(one.start, robot) or not within:
        return "beyond the joint limits"
    spheres.set_obstacles(scene_of(one.obstacles))
    nearest = sorted(within, key=lambda goal: float(np.abs(np.subtract(goal, one.start)).max()))
    free = [goal for goal in nearest if spheres.free(np.array(goal))]
    line = {
        "task": "SE",
        "family": one.family,
        "start": list(one.start),
        "goal": list((free or nearest)[0]),
        "obstacles": list(one.obstacles),
    }
    return line, bool(free)


def _within(q: Any, robot: Robot) -> bool:
    """As a set's file is read: in single precision."""
    q = np.asarray(q, np.float32)
    lower, upper = robot.joint_lower.astype(np.float32), robot.joint_upper.astype(np.float32)
    return bool(np.all((lower <= q) & (q <= upper)))
