"""What a result file is called, and what lies beside it.

A result is `x.json`, or `x.json.gz` where it is compressed. What belongs to it is named after `x`,
so only one of the two may be there:

    x.json.partial  the log of a run in progress (x.json.gz.partial of one that ends compressed)
    x.trajectories  a folder of the trajectories of a run in progress
    x.npz           its trajectories
    x               a folder of its recordings
"""

import os
from pathlib import Path

SUFFIXES = (".json", ".json.gz")

Name = str | os.PathLike[str]


def is_result(path: Name) -> bool:
    """Whether a file of this name is a result file."""
    name = Path(path).name
    return any(name.endswith(suffix) and name != suffix for suffix in SUFFIXES)


def is_compressed(path: Name) -> bool:
    """Whether what a file of this name holds is compressed with gzip."""
    return Path(path).suffix == ".gz"


def forms(path: Name) -> tuple[Path, Path]:
    """The names that the same result has, plain and compressed."""
    plain, compressed = (_beside(path, suffix) for suffix in SUFFIXES)
    return plain, compressed


def log_file(path: Name) -> Path:
    """The log of the run that will end as this file."""
    path = Path(path)
    return path.with_name(f"{path.name}.partial")


def trajectories_file(path: Name) -> Path:
    """The file of the trajectories of a run."""
    return _beside(path, ".npz")


def batches_folder(path: Name) -> Path:
    """The folder that holds the trajectories of a run until it ends."""
    return _beside(path, ".trajectories")


def recordings_folder(path: Name) -> Path:
    """The folder of recordings and videos of a run."""
    return _beside(path, "")


def _beside(path: Name, suffix: str) -> Path:
    path = Path(path)
    return path.with_name(_stem(path.name) + suffix)


def _stem(name: str) -> str:
    for suffix in reversed(SUFFIXES):
        if name.endswith(suffix) and name != suffix:
            return name.removesuffix(suffix)
    return Path(name).stem  # not named as a result: what `load` is given may have any name
