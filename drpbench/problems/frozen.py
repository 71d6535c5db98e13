"""The sets that come with the package, guarded by a checksum.

A set is `data/<name>.npz` (arrays, no pickle) and `data/<name>.json` (its manifest: counts,
checksum, what it was made with). A set never changes; a fix makes a set of a new name.
"""

from __future__ import annotations

import hashlib
import io
import json
from functools import cache
from pathlib import Path

import numpy as np

from drpbench.geometry import Obstacles

from .problem_set import ProblemSet
from .task_problems import ProblemSetError, TaskProblems

DATA = Path(__file__).parent / "data"


def installed(folder: Path = DATA) -> tuple[str, ...]:
    """The names of the sets that come with the package."""
    return tuple(sorted(path.stem for path in folder.glob("*.json")))


@cache
def read_frozen(name: str, folder: Path = DATA) -> ProblemSet:
    """The set `name`, read and checked once a process. Raises ProblemSetError for damaged data."""
    manifest, path = _manifest(name, folder), folder / f"{name}.npz"
    if not path.is_file():
        raise ProblemSetError(f"{path} is missing: install the package again")
    content = path.read_bytes()
    found = hashlib.sha256(content).hexdigest()
    if found != manifest["sha256"]:
        raise ProblemSetError(
            f"{path} is damaged: its checksum is {found[:12]}..., "
            f"the manifest says {manifest['sha256'][:12]}...; install the package again"
        )
    with np.load(io.BytesIO(content), allow_pickle=False) as archive:
        arrays = {key: archive[key] for key in archive.files}
    return ProblemSet(
        name=name,
        sha256=found,
        problems={task: _problems(task, arrays) for task in manifest["tasks"]},
        arm=manifest.get("arm", "panda"),
        finger_opening=manifest.get("finger_opening", 0.04),
        ground=manifest.get("ground", True),
    )


def _manifest(name: str, folder: Path) -> dict:
    path = folder / f"{name}.json"
    try:
        manifest = json.loads(path.read_text())
        if not manifest["tasks"] or not isinstance(manifest["sha256"], str):
            raise KeyError
    except (OSError, ValueError, KeyError, TypeError):
        raise ProblemSetError(f"{path} is damaged: not the manifest of a problem set") from None
    return manifest


def _problems(task: str, arrays: dict[str, np.ndarray]) -> TaskProblems:
    mine = {
        key.removeprefix(f"{task}_"): array
        for key, array in arrays.items()
        if key.startswith(f"{task}_")
    }
    counts, n = mine["obstacle_count"], len(mine["start"])
    width = int(counts.max())
    there = np.arange(width) < counts[:, None]
    obstacles = Obstacles.absent(n, width)
    for name in ("kind", "half_size", "position", "quaternion"):
        getattr(obstacles, name)[there] = mine[name]
    obstacles.mask[:] = there
    return TaskProblems(
        task=task,
        obstacles=obstacles,
        start=mine["start"],
        goal=mine["goal"],
        goal_position=mine["goal_position"],
        goal_quaternion=mine["goal_quaternion"],
        family=mine["family"].tolist(),
        pair=mine["pair"].tolist(),
        level=mine["level"].astype(np.int32),
        witness=np.split(mine["witness"], np.cumsum(mine["witness_count"])[:-1]),
    )
