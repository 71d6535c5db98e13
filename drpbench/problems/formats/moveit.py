"""MoveIt's planning scenes and motion plan requests, as MotionBenchMaker writes them.

A folder holds `scene0001.yaml` beside `request0001.yaml`, and so on; its name is the family's. The
request has the start and one goal in joints, by the joints' names; the scene has collision objects
of primitives. An object may have a pose of its own that those of its primitives are relative to.
Orientations are xyzw. The start names the fingers' joints too: MotionBenchMaker has each 6.5 cm
from the middle, farther than the real hand can open, and some of its goals are free only so.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from drpbench.geometry.host_rotation import multiply

from .problem import FormatError, OtherProblem, field, items, numbers, obstacle, require_room
from .yaml_file import read_yaml

USUAL_OPENING = 0.04  # [m], where a request does not say
_UNTURNED = np.array([1.0, 0.0, 0.0, 0.0])


def read_moveit(folder: Path, arm: str, joints: int) -> Iterator[OtherProblem]:
    """Every problem in a folder and those below it, in the order of their names.

    Raises FormatError.
    """
    requests = sorted(folder.rglob("request*.yaml"))
    if not requests:
        raise FormatError(
            f"{folder}: expected MoveIt's request0001.yaml and scene0001.yaml, got none"
        )
    for request in requests:
        scene = request.with_name(request.name.replace("request", "scene", 1))
        if not scene.is_file():
            raise FormatError(f"{request}: there is no {scene.name} beside it")
        yield _problem(request, scene, arm, joints)


def _problem(request: Path, scene: Path, arm: str, joints: int) -> OtherProblem:
    asked, world = read_yaml(request), read_yaml(scene)
    names = [f"{arm}_joint{number}" for number in range(1, joints + 1)]
    state = field(field(asked, "start_state", f"{request}"), "joint_state", f"{request}")
    where = f"{request}: start_state"
    stated = items(field(state, "name", where), where)
    start = dict(
        zip(stated, numbers(field(state, "position", where), len(stated), where), strict=True)
    )
    where = f"{request}: goal_constraints"
    goals = items(field(asked, "goal_constraints", f"{request}"), where)
    if len(goals) != 1 or not isinstance(goals[0], dict) or not goals[0].get("joint_constraints"):
        raise FormatError(f"{where}: expected one goal of joint_constraints")
    goal = {}
    for one in items(goals[0]["joint_constraints"], where):
        name, value = field(one, "joint_name", where), field(one, "position", where)
        (goal[name],) = numbers([value], 1, where)
    for given, what in ((start, "start_state"), (goal, "goal_constraints")):
        if missing := [name for name in names if name not in given]:
            arms = f"an arm called {arm}, whose joints are {names[0]} to {names[-1]}"
            raise FormatError(f"{request}: {what}: expected {arms}; there is no {missing[0]}")
    fingers = {value for name, value in start.items() if "finger" in name}
    if len(fingers) > 1:
        raise FormatError(f"{request}: expected both fingers equally open, got {sorted(fingers)}")
    return OtherProblem(
        where=str(request),
        family=request.parent.name.removesuffix(f"_{arm}"),
        start=[start[name] for name in names],
        goals=[[goal[name] for name in names]],
        obstacles=_obstacles(world, scene),
        finger_opening=fingers.pop() if fingers else USUAL_OPENING,
    )


def _obstacles(world: Any, path: Path) -> list[dict[str, Any]]:
    found: list[dict[str, Any]] = []
    listed = field(field(world, "world", str(path)), "collision_objects", str(path))
    for one in items(listed, str(path)):
        where = f"{path}: {str(field(one, 'id', str(path)))[:40]}"
        if one.get("meshes") or one.get("planes"):
            raise FormatError(
                f"{where}: expected boxes, cylinders and spheres, got a mesh or plane"
            )
        solids = items(one.get("primitives", []), where)
        poses = items(one.get("primitive_poses", []), where)
        if len(solids) != len(poses):
            raise FormatError(f"{where}: {len(solids)} primitives with {len(poses)} poses")
        own = _pose(one["pose"], where) if one.get("pose") else (_UNTURNED, np.zeros(3))
        for solid, pose in zip(solids, poses, strict=True):
            shape, size = _solid(solid, where)
            turn, place = _pose(pose, where)
            position = own[1] + _turned(place, own[0])
            quaternion = multiply(own[0], turn)
            found.append(obstacle(shape, size, position.tolist(), quaternion.tolist(), where))
    require_room(found, str(path))
    return found


def _solid(values: Any, where: str) -> tuple[str, dict[str, Any]]:
    """MoveIt's dimensions: a box's extents, a cylinder's height and radius, a sphere's radius."""
    kind, size = field(values, "type", where), field(values, "dimensions", where)
    if kind == "box":
        return "box", {"size": numbers(size, 3, where)}
    if kind == "cylinder":
        height, radius = numbers(size, 2, where)
        return "cylinder", {"radius": radius, "height": height}
    if kind == "sphere":
        return "sphere", {"radius": numbers(size, 1, where)[0]}
    raise FormatError(f"{where}: expected a box, cylinder or sphere, got {kind!r}")


def _pose(values: Any, where: str) -> tuple[np.ndarray, np.ndarray]:
    """Quaternion (4,) wxyz and position (3,)."""
    place = numbers(field(values, "position", where), 3, where)
    x, y, z, w = numbers(field(values, "orientation", where), 4, where)
    return np.array([w, x, y, z]), np.array(place)


def _turned(vector: np.ndarray, quaternion: np.ndarray) -> np.ndarray:
    """q v q*"""
    back = quaternion * [1, -1, -1, -1]
    return multiply(multiply(quaternion, np.array([0.0, *vector])), back)[1:]
