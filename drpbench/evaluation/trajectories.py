"""What moved, step by step: an NPZ beside the result file."""

import os
import zipfile
import zlib
from pathlib import Path

import numpy as np

from .rollout import Trace


class Trajectories:
    """Joint positions and moving obstacles of every episode of a run.

    The file `x.npz` beside `x.json` holds, for an instance with key `FDO-17`:

        FDO-17/joint_position   (T + 1, 7) float32 [rad], the start first
        FDO-17/joint_velocity   (T, 7) float32 [rad/s], at the end of each control step
        FDO-17/mover_position   (T, M, 3) float32 [m], centres of the moving boxes
        FDO-17/mover_active     (T, M) bool
        FDO-17/mover_half_size  (T, M, 3) float32 [m]; a box of SAO changes when it is put elsewhere
        FDO-17/mover_rotation   (T, M, 3, 3) float32

    Batches are kept in a folder `x.trajectories` until the run ends, so that a resumed run has them all.
    """

    def __init__(self, out: Path):
        self.path = out.with_suffix(".npz")
        self.folder = out.with_suffix(".trajectories")
        self.folder.mkdir(parents=True, exist_ok=True)

    def add(self, task: str, ids: list[int], trace: Trace) -> None:
        """A batch's episodes, written whole or not at all."""
        arrays = {}
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
        arrays = {}
        for part in parts:
            with np.load(part) as batch:
                arrays |= {name: batch[name] for name in batch.files}
        _write(self.path, arrays)
        for part in parts:
            part.unlink()
        self.folder.rmdir()


def load_trajectories(path: Path) -> dict[str, dict[str, np.ndarray]]:
    """Arrays by instance (`FDO-17`) and by name. ValueError for a file that is not of this kind."""
    try:
        with np.load(path, allow_pickle=False) as file:
            found: dict[str, dict[str, np.ndarray]] = {}
            for name in file.files:
                instance, _, field = name.partition("/")
                found.setdefault(instance, {})[field] = file[name]
            return found
    except (OSError, ValueError, EOFError, zipfile.BadZipFile, zlib.error) as error:
        raise ValueError(f"{path}: not a readable trajectory file ({error})") from None


def _write(path: Path, arrays: dict[str, np.ndarray]) -> None:
    partial = path.with_suffix(".npz.tmp")
    with open(partial, "wb") as file:
        np.savez_compressed(file, **arrays)
        file.flush()
        os.fsync(file.fileno())
    os.replace(partial, path)
