"""What is learned from: scenes and the expert's paths through them, and nothing that can be
computed.

Point clouds are sampled from the primitives at every training step, the arm's from its kinematics.
"""

from __future__ import annotations

import hashlib
import io
import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import jax
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from drpbench.errors import DrpbenchError
from drpbench.geometry import Obstacles

FORMAT = 1
MANIFEST = "manifest.json"


class DataError(DrpbenchError):
    """A folder of demonstrations that is missing, damaged, or of another kind."""


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Demonstrations:
    """Solved problems, one or a batch of N, K obstacle slots, T waypoints, J joints. Lengths [m],
    joints [rad], wxyz.

    `path` is the expert's, its waypoints at even steps of travel time; `length` is the time [s]
    that it takes at the arm's velocity limits. It ends at `goal` where `reached`, and else as near
    to it as the arm gets without touching. `index` is the problem's number in its stream.
    """

    index: Int[Array, "*batch"] | Int[np.ndarray, "*batch"]
    family: Int[Array, "*batch"] | Int[np.ndarray, "*batch"]
    obstacles: Obstacles
    goal: Float[Array, "*batch J"] | Float[np.ndarray, "*batch J"]
    path: Float[Array, "*batch T J"] | Float[np.ndarray, "*batch T J"]
    length: Float[Array, "*batch"] | Float[np.ndarray, "*batch"]
    reached: Bool[Array, "*batch"] | Bool[np.ndarray, "*batch"]

    @property
    def count(self) -> int:
        """N."""
        return self.index.shape[0]

    def arrays(self) -> dict[str, np.ndarray]:
        """All arrays by the names that a shard has them under, the obstacles' among them."""
        own = {f.name: getattr(self, f.name) for f in fields(self) if f.name != "obstacles"}
        scenes = {f.name: getattr(self.obstacles, f.name) for f in fields(Obstacles)}
        return {name: np.asarray(array) for name, array in (own | scenes).items()}

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, np.ndarray]) -> Demonstrations:
        """The inverse of `arrays`."""
        own = {f.name: arrays[f.name] for f in fields(cls) if f.name != "obstacles"}
        return cls(
            **own, obstacles=Obstacles(**{f.name: arrays[f.name] for f in fields(Obstacles)})
        )


def join(parts: Sequence[Demonstrations]) -> Demonstrations:
    """All of them as one, on the host."""
    return jax.tree.map(lambda *leaves: np.concatenate([np.asarray(x) for x in leaves]), *parts)


class Shards:
    """A folder of demonstrations: one NPZ for each range of problem numbers, and a manifest.

    A range is written once and whole, so a run that was cut off goes on at the first range that is
    not there, and another run may add further ranges. Raises DataError.
    """

    def __init__(self, folder: Path, stream: str):
        self.folder, self._stream = folder, stream
        if (folder / MANIFEST).exists():
            manifest = read_manifest(folder)
            wanted = {"format": FORMAT, "stream": stream}
            for name, value in wanted.items():
                if manifest[name] != value:
                    raise DataError(
                        f"{folder} holds data of {name} {manifest[name]!r}, not {value!r}: "
                        "name another folder"
                    )
            # What is damaged is made anew.
            manifest["shards"] = {
                first: row for first, row in manifest["shards"].items() if _sound(folder, row)
            }
            self._manifest = manifest
        else:
            if folder.exists() and any(folder.iterdir()):
                raise DataError(f"{folder} is not empty and has no {MANIFEST}: name another folder")
            self._manifest = {"format": FORMAT, "stream": stream, "shards": {}}

    @property
    def done(self) -> list[range]:
        """The ranges that are there, in order."""
        rows = self._manifest["shards"].items()
        return sorted(
            (range(int(first), int(first) + row["drawn"]) for first, row in rows),
            key=lambda one: one.start,
        )

    def solved(self, numbers: range) -> int:
        """How many were solved of the ranges that begin in `numbers`."""
        rows = self._manifest["shards"].items()
        return sum(row["solved"] for first, row in rows if int(first) in numbers)

    def missing(self, numbers: range, most: int) -> list[range]:
        """What of `numbers` is not there, in ranges that end at multiples of `most`."""
        found = []
        first = numbers.start
        for there in [*self.done, range(numbers.stop, numbers.stop)]:
            while first < min(there.start, numbers.stop):
                last = min((first // most + 1) * most, there.start, numbers.stop)
                found.append(range(first, last))
                first = last
            first = max(first, there.stop)
        return found

    @property
    def counts(self) -> dict[str, int]:
        """Sums over all shards: problems drawn, solved, and solved with the goal obstructed."""
        rows = self._manifest["shards"].values()
        return {name: sum(row[name] for row in rows) for name in ("drawn", "solved", "obstructed")}

    def add(self, numbers: range, solved: Demonstrations) -> None:
        """Writes a range of problem numbers; `solved` are those of it that were."""
        self.folder.mkdir(parents=True, exist_ok=True)
        buffer = io.BytesIO()
        arrays: dict[str, Any] = solved.arrays()
        np.savez_compressed(buffer, **arrays)
        content = buffer.getvalue()
        name = f"{self._stream}-{numbers.start:09d}.npz"
        _replace(self.folder / name, content)
        self._manifest["shards"][str(numbers.start)] = {
            "file": name,
            "sha256": hashlib.sha256(content).hexdigest(),
            "drawn": len(numbers),
            "solved": solved.count,
            "obstructed": int(np.sum(~np.asarray(solved.reached))),
        }
        text = json.dumps(self._manifest, indent=1) + "\n"
        _replace(self.folder / MANIFEST, text.encode())


def _replace(path: Path, content: bytes) -> None:
    """Writes a whole file or none of it."""
    partial = path.with_name(path.name + ".partial")
    partial.write_bytes(content)
    os.replace(partial, path)


def read_manifest(folder: Path) -> dict:
    """The manifest of a folder of demonstrations."""
    path = folder / MANIFEST
    if not path.is_file():
        raise DataError(
            f"{folder} holds no demonstrations (no {MANIFEST}): make some with drpbench data"
        )
    try:
        manifest = json.loads(path.read_text())
        if not isinstance(manifest["shards"], dict):
            raise KeyError
        manifest["format"], manifest["stream"]
    except (ValueError, KeyError, TypeError):
        raise DataError(f"{path} is damaged: it is not the manifest of demonstrations") from None
    return manifest


def _sound(folder: Path, row: dict) -> bool:
    """Whether a shard is there as it was written."""
    path = folder / row["file"]
    return path.is_file() and hashlib.sha256(path.read_bytes()).hexdigest() == row["sha256"]


def read(folder: Path) -> Demonstrations:
    """All demonstrations of a folder, each shard checked against its checksum, in order of
    number."""
    manifest = read_manifest(folder)
    if manifest["format"] != FORMAT:
        raise DataError(f"{folder} is of format {manifest['format']}; this version reads {FORMAT}")
    parts = []
    for _, row in sorted(manifest["shards"].items(), key=lambda item: int(item[0])):
        path = folder / row["file"]
        if not _sound(folder, row):
            what = "damaged" if path.exists() else "missing"
            raise DataError(f"{path} is {what}: run drpbench data again, which makes it anew")
        with np.load(path, allow_pickle=False) as arrays:
            parts.append(Demonstrations.from_arrays(arrays))
    if not parts:
        raise DataError(f"{folder} holds no shard yet")
    return join(parts)
