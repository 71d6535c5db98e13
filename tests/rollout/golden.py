"""Golden traces: what `rmp` and `drp` did in the first 16 problems of each task, as digests.

`python -m tests.rollout.golden RESULT.npz POLICY` notes the trajectories of a run with
--save-trajectories. With `--check` it compares instead. Rounding differs from processor to
processor and from one jaxlib to the next, so digests are kept for each of them. They may change
only where rounding is meant to change.
"""

import argparse
import hashlib
import importlib.metadata
import json
from pathlib import Path

import numpy as np

FILE = Path(__file__).with_name("golden_traces.json")
PROBLEMS = 16


def processor() -> str:
    """What decides the rounding: the processor's model and features, and the compiler's version."""
    lines = Path("/proc/cpuinfo").read_text().splitlines()
    said = sorted({line for line in lines if line.startswith(("model name", "flags"))})
    digest = hashlib.sha256("\n".join(said).encode()).hexdigest()[:12]
    return f"jaxlib {importlib.metadata.version('jaxlib')}, processor {digest}"


def digest(joint_position: np.ndarray) -> str:
    """Of one episode's joint positions (T, J) float32 [rad]."""
    return hashlib.sha256(np.ascontiguousarray(joint_position, "<f4").tobytes()).hexdigest()[:16]


def golden() -> dict[str, list[str]]:
    """Digests by "POLICY TASK" on this processor; empty where there are none."""
    try:
        return json.loads(FILE.read_text()).get(processor(), {})
    except FileNotFoundError:
        return {}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("trajectories", type=Path)
    parser.add_argument("policy")
    parser.add_argument("--check", action="store_true")
    given = parser.parse_args()
    arrays = np.load(given.trajectories)
    tasks = dict.fromkeys(name.partition("-")[0] for name in arrays.files)
    found = {
        f"{given.policy} {task}": [
            digest(arrays[f"{task}-{id}/joint_position"]) for id in range(PROBLEMS)
        ]
        for task in tasks
    }
    if given.check:
        known = golden()
        for name, digests in found.items():
            same = sum(a == b for a, b in zip(digests, known.get(name, ()), strict=False))
            print(f"{name}: {same} of {PROBLEMS} are the golden ones")
        return
    everything = json.loads(FILE.read_text()) if FILE.is_file() else {}
    everything[processor()] = golden() | found
    FILE.write_text(json.dumps(everything, indent=1) + "\n")


if __name__ == "__main__":
    main()
