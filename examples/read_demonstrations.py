"""Demonstrations without drpbench: a folder of `drpbench data` is read with NumPy alone.

    drpbench data --out data/ --count 256
    python examples/read_demonstrations.py data/

For PyTorch, `torch.from_numpy(arrays["path"])` and a `TensorDataset` of what your network takes.
"""

import json
import sys
from pathlib import Path

import numpy as np


def read(folder: Path) -> dict[str, np.ndarray]:
    """All demonstrations of a folder by name, the first axis theirs."""
    shards = json.loads((folder / "manifest.json").read_text())["shards"].values()
    parts = [dict(np.load(folder / shard["file"], allow_pickle=False)) for shard in shards]
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def main() -> None:
    arrays = read(Path(sys.argv[1]))
    for name, array in arrays.items():
        print(f"{name:11} {array.dtype!s:8} {array.shape}")
    joints = arrays["path"]
    # Waypoints are evenly spaced in time: so long [s] is one step of the expert at full speed.
    step = arrays["length"] / (joints.shape[1] - 1)
    print(f"{len(joints)} paths, a step lasts {1000 * step.mean():.0f} ms on average")


if __name__ == "__main__":
    main()
