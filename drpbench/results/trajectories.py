"""What moved, step by step: an NPZ beside the result file."""

import os
import zipfile
import zlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from drpbench.results.names import batches_folder, trajectories_file
from drpbench.rollout import Trace

from .schema import ResultsError


class Trajectories:
    """Joint positions and moving obstacles of every episode of a run.

    The file `x.npz` beside `x.json` or `x.json.gz` holds, for an instance with key `FDO-17`:

        FDO-17/joint_position   (T + 1, J) float32 [rad], the start first
        FDO-17/joint_velocity   (T, J) float32 [rad/s], at the end of each control step
        FDO-17/mover_position   (T, M, 3) float32 [m], centres of the moving boxes
        FDO-17/mover_active     (T, M) bool
        FDO-17/mover_half_size  (T, M, 3) float32 [m]; a box of SAO changes when it is put elsewhere
        FDO-17/mover_rotation   (T, M, 3, 3) float32

    Batches are kept in a folder `x.trajectories` until the run ends, so that a resumed run has them
    all.
    """

    def __init__(self, out: Path):
        self.path = trajectories_file(out)
        self.folder = batches_folder(out)
        self.folder.mkdir(parents=True, exist_ok=True)

    def add(self, task: str, ids: list[int], trace: Trace) -> None:
        """A batch's episodes, written whole or not at all."""
        arrays: dict[str, np.ndarray] = {}
        for b, id in enumerate(ids):
            joints = np.concatenate([trace.start[None, b], trace.joint_position[:, b]])
            arrays |= {
                f"{task}-{id}/joint_position": joints.astype(np.float32),
                f"{task}-{id}/joint_velocity": trace.joint_velocity[:, b],
                f"{task}-{id}/mover_position": trace.mover_position[:, b],
                f"{task}-{id}/mover_active": trace.mover_active[:, b],
                f"{task}-{id}/mover_half_size": trace.mover_half_size[:, b],
                f"{task}-{id}/mover_rotation": trace.mover_rotation[:, b],
            }
        _write(self.folder / f"{task}-{ids[0]}.npz", arrays)

    def finish(self) -> None:
        """Joins the batches into one file, and removes them."""
        parts = sorted(self.folder.glob("*.npz"))
        arrays: dict[str, np.ndarray] = {}
        for part in parts:
            with np.load(part) as batch:
                arrays |= {name: batch[name] for name in batch.files}
        _write(self.path, arrays)
        for part in parts:
            part.unlink()
        self.folder.rmdir()


def load_trajectories(path: Path) -> Mapping[str, Mapping[str, np.ndarray]]:
    """Arrays by instance (`FDO-17`) and by name; an instance is read when it is asked for.

    Raises ResultsError for a file that is not of this kind, and for an instance that is damaged.
    """
    return _Recorded(path)


class _Recorded(Mapping[str, Mapping[str, np.ndarray]]):
    def __init__(self, path: Path):
        self.path = path
        with self._reading():
            file = np.load(path, allow_pickle=False)
            if not isinstance(file, np.lib.npyio.NpzFile):
                raise ValueError("one array, not an archive of them")
        self._file = file
        self._fields: dict[str, list[str]] = {}
        for name in file.files:
            instance, _, field = name.partition("/")
            self._fields.setdefault(instance, []).append(field)

    def __getitem__(self, instance: str) -> dict[str, np.ndarray]:
        fields = self._fields[instance]
        with self._reading():
            return {field: self._file[f"{instance}/{field}"] for field in fields}

    def __contains__(self, instance: object) -> bool:
        return instance in self._fields

    def __iter__(self) -> Iterator[str]:
        return iter(self._fields)

    def __len__(self) -> int:
        return len(self._fields)

    @contextmanager
    def _reading(self) -> Iterator[None]:
        try:
            yield
        except (OSError, ValueError, EOFError, zipfile.BadZipFile, zlib.error) as error:
            told = f"{self.path}: not a readable trajectory file ({error})"
            raise ResultsError(told) from None


def _write(path: Path, arrays: dict[str, np.ndarray]) -> None:
    partial = path.with_suffix(".npz.tmp")
    with open(partial, "wb") as file:
        np.savez_compressed(file, **arrays)  # type: ignore[arg-type]
        file.flush()
        os.fsync(file.fileno())
    os.replace(partial, path)
