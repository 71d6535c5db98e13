"""Frozen problem sets: numbered problems shipped with the package, guarded by a checksum.

A set is `data/<name>.npz` (arrays, no pickle) and `data/<name>.json` (its manifest: counts,
checksum, what it was made with). A set never changes; a fix makes a set of a new name.
"""

from __future__ import annotations

import hashlib
import io
import json
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from drpbench.errors import DrpbenchError

DATA = Path(__file__).parent / "data"
PROBLEM_SET = "drpbench-v1"
TASKS = ("SE", "SAO", "FDO", "GB", "DGB")
_SHAPES = ("box", "cylinder", "sphere")


class ProblemSetError(DrpbenchError):
    """The set, the task or the number asked for is not there, or the data are damaged."""


@dataclass(frozen=True)
class ProblemSet:
    """The n problems of one task, their obstacles padded to K. Lengths [m], joints [rad], wxyz.

    `kind` is 0 box, 1 cylinder (axis z), 2 sphere; `half_size` a box's half extents, (radius,
    radius, half height), or (radius, radius, radius). Where `mask` is false there is no obstacle.
    `witness` holds one polyline (m, 7) a problem, linear in joint space between its waypoints and
    free of collision in the static scene. Goal poses are those of the frame `grip`.
    """

    name: str
    sha256: str
    task: str
    kind: np.ndarray  # (n, K) int32
    half_size: np.ndarray  # (n, K, 3) float32
    position: np.ndarray  # (n, K, 3) float32
    quaternion: np.ndarray  # (n, K, 4) float32
    mask: np.ndarray  # (n, K) bool
    start: np.ndarray  # (n, 7) float32
    goal: np.ndarray  # (n, 7) float32
    goal_position: np.ndarray  # (n, 3) float32
    goal_quaternion: np.ndarray  # (n, 4) float32
    family: list[str]
    pair: list[str]
    level: np.ndarray  # (n,) int32
    witness: list[np.ndarray]  # n arrays (m, 7) float32

    @property
    def count(self) -> int:
        """n, the number of problems."""
        return len(self.family)

    def to_json(self, index: int) -> dict:
        """Problem number `index` as plain values, for other tools.

        Numbers are the shortest that give back the stored float32.
        """
        if not 0 <= index < self.count:
            raise ProblemSetError(
                f"{self.task} has problems 0 to {self.count - 1}, and no number {index}"
            )
        obstacles = [
            _obstacle(*values)
            for values in zip(
                self.kind[index],
                self.half_size[index],
                self.position[index],
                self.quaternion[index],
                self.mask[index],
                strict=True,
            )
            if values[-1]
        ]
        return {
            "id": index,
            "task": self.task,
            "family": self.family[index],
            "pair": self.pair[index],
            "level": int(self.level[index]),
            "start": _plain(self.start[index]),
            "goal": _plain(self.goal[index]),
            "obstacles": obstacles,
            "witness": [_plain(q) for q in self.witness[index]],
        }


def load(task: str, name: str = PROBLEM_SET, folder: Path = DATA) -> ProblemSet:
    """The problems of one task of the set `name`.

    Raises `ProblemSetError` for a task or set that is not there and for damaged data.
    """
    if task not in TASKS:
        raise ProblemSetError(f"there is no task {task!r}; the tasks are {', '.join(TASKS)}")
    manifest, arrays = _archive(name, folder)
    mine = {
        key.removeprefix(f"{task}_"): array
        for key, array in arrays.items()
        if key.startswith(f"{task}_")
    }
    counts, n = mine["obstacle_count"], len(mine["start"])
    width = int(counts.max())
    mask = np.arange(width) < counts[:, None]

    def padded(flat: np.ndarray, filler) -> np.ndarray:
        out = np.broadcast_to(np.asarray(filler, flat.dtype), (n, width, *flat.shape[1:])).copy()
        out[mask] = flat
        return out

    ends = np.cumsum(mine["witness_count"])[:-1]
    return ProblemSet(
        name=name,
        sha256=manifest["sha256"],
        task=task,
        kind=padded(mine["kind"].astype(np.int32), 0),
        # A filler is a proper box, so that geometry on padded arrays stays finite.
        half_size=padded(mine["half_size"], 0.01),
        position=padded(mine["position"], 0.0),
        quaternion=padded(mine["quaternion"], (1.0, 0.0, 0.0, 0.0)),
        mask=mask,
        start=mine["start"],
        goal=mine["goal"],
        goal_position=mine["goal_position"],
        goal_quaternion=mine["goal_quaternion"],
        family=mine["family"].tolist(),
        pair=mine["pair"].tolist(),
        level=mine["level"].astype(np.int32),
        witness=np.split(mine["witness"], ends),
    )


def counts(name: str = PROBLEM_SET, folder: Path = DATA) -> dict[str, int]:
    """Number of problems of each task of the set `name`."""
    return {task: entry["count"] for task, entry in _manifest(name, folder)["tasks"].items()}


def _manifest(name: str, folder: Path) -> dict:
    path = folder / f"{name}.json"
    if not path.is_file():
        there = ", ".join(sorted(p.stem for p in folder.glob("*.json"))) or "none"
        raise ProblemSetError(f"there is no problem set {name!r}; those installed: {there}")
    try:
        manifest = json.loads(path.read_text())
        if set(manifest["tasks"]) != set(TASKS) or not isinstance(manifest["sha256"], str):
            raise KeyError
    except (ValueError, KeyError, TypeError):
        raise ProblemSetError(f"{path} is damaged: not the manifest of a problem set") from None
    return manifest


@cache
def _archive(name: str, folder: Path) -> tuple[dict, dict[str, np.ndarray]]:
    """Manifest and arrays, read and checked once a process."""
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
        return manifest, {key: archive[key] for key in archive.files}


def _plain(values: np.ndarray) -> list[float]:
    """Shortest decimals that read back as the same float32."""
    return [float(str(value)) for value in values.astype(np.float32)]


def _obstacle(kind, half_size, position, quaternion, _mask) -> dict:
    """An obstacle as the export has it: full extents of a box, radius and height of the others."""
    shape = _SHAPES[kind]
    full = _plain(2 * half_size)
    radius = _plain(half_size)[0]
    size = {
        "box": {"size": full},
        "cylinder": {"radius": radius, "height": full[2]},
        "sphere": {"radius": radius},
    }[shape]
    return {"shape": shape, **size, "position": _plain(position), "quaternion": _plain(quaternion)}
