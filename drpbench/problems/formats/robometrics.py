"""Robometrics' YAML: families of problems with goals in joints and as a pose.

    family:
    - start: [7 numbers]              goal_ik: [[7 numbers], ...]
      obstacles: {cuboid: {name: {dims, pose}}, cylinder: {name: {radius, height, pose}}}
      collision_buffer_ik: 0.0        world_frame: panda_link0

Poses are x, y, z, qw, qx, qy, qz. A negative `collision_buffer_ik` says that every goal touches.
"""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from .problem import FormatError, OtherProblem, field, items, numbers, obstacle, require_room
from .yaml_file import read_yaml

OPENING = 0.025  # [m] of each finger from the middle; no file says it


def read_robometrics(path: Path, arm: str, joints: int) -> Iterator[OtherProblem]:
    """Every problem in a file, in its order. Raises FormatError."""
    families = read_yaml(path)
    if not isinstance(families, Mapping) or not families:
        raise FormatError(f"{path}: expected families of problems")
    for family, listed in families.items():
        for number, one in enumerate(items(listed, f"{path}: {family}")):
            where = f"{path}: {family} {number}"
            frame = one.get("world_frame") if isinstance(one, Mapping) else None
            if frame not in (None, f"{arm}_link0"):
                raise FormatError(f"{where}: expected the frame {arm}_link0, got {frame!r}")
            goals = items(field(one, "goal_ik", where), where)
            (room,) = numbers([one.get("collision_buffer_ik", 0)], 1, where)
            yield OtherProblem(
                where=where,
                family=str(family).removesuffix(f"_{arm}"),
                start=numbers(field(one, "start", where), joints, f"{where}: start"),
                goals=[numbers(goal, joints, f"{where}: goal_ik") for goal in goals],
                obstacles=_obstacles(field(one, "obstacles", where), where),
                finger_opening=OPENING,
                infeasible=room < 0,
            )


def _obstacles(listed: Any, where: str) -> list[dict[str, Any]]:
    found = []
    if not isinstance(listed, Mapping):
        raise FormatError(f"{where}: obstacles: expected cuboid and cylinder")
    for kind, solids in listed.items():
        if kind not in ("cuboid", "cylinder", "sphere"):
            raise FormatError(f"{where}: obstacles: expected cuboid and cylinder, got {kind!r}")
        if not isinstance(solids, Mapping):
            raise FormatError(f"{where}: {kind}: expected obstacles by name")
        for name, one in solids.items():
            at = f"{where}: {name}"
            size: dict[str, Any]
            if kind == "cuboid":
                size = {"size": numbers(field(one, "dims", at), 3, at)}
            else:
                wanted = ("radius", "height") if kind == "cylinder" else ("radius",)
                size = {of: numbers([field(one, of, at)], 1, at)[0] for of in wanted}
            pose = numbers(field(one, "pose", at), 7, at)
            shape = "box" if kind == "cuboid" else str(kind)
            found.append(obstacle(shape, size, pose[:3], pose[3:], at))
    require_room(found, where)
    return found
