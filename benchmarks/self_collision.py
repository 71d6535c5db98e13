"""How often a policy's arm touches itself, by the spheres and by the real meshes, as Markdown.

    DRPBENCH_MESHES=FOLDER python benchmarks/self_collision.py RESULT.json...

Each result was made by `drpbench run --save-trajectories`. The spheres' word is the row's
`self_collided`. The meshes are put at every recorded posture in C MuJoCo; the links that may touch
are the same.
"""

import argparse
from collections import defaultdict
from pathlib import Path

import numpy as np

from drpbench.planning.checker import mesh_checker
from drpbench.results import load
from drpbench.results.names import trajectories_file
from drpbench.results.trajectories import load_trajectories
from drpbench.robot import PANDA

DEEP = 0.005  # [m]


def self_clearance(checker, joint_position: np.ndarray) -> tuple[float, str]:
    """Smallest distance [m] of two links over an episode's postures (T, J), and which links."""
    smallest, pair = checker.margin, ""
    for q in joint_position:
        for a, b, distance in checker.contacts(q):
            if distance < smallest and "obstacle" not in a + b:
                smallest, pair = distance, f"{a} and {b}"
    return smallest, pair


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("results", type=Path, nargs="+")
    model = PANDA.meshes.find()
    if model is None:
        raise SystemExit(PANDA.meshes.absent)
    checker = mesh_checker(model, margin=0.0)
    counts = defaultdict(lambda: defaultdict(int))
    pairs = defaultdict(int)
    for path in parser.parse_args().results:
        result = load(path)
        recorded = load_trajectories(trajectories_file(path))
        for row in result.rows:
            if not row.valid:
                continue
            depth, pair = self_clearance(
                checker, recorded[f"{row.task}-{row.id}"]["joint_position"]
            )
            count = counts[result.header.policy, row.task]
            count["episodes"] += 1
            count["successes"] += row.success
            for kind, is_one in (("", True), ("successes, ", row.success)):
                count[kind + "spheres"] += is_one and row.self_collided
                count[kind + "meshes"] += is_one and depth < 0.0
                count[kind + "deep"] += is_one and depth < -DEEP
                count[kind + "meshes alone"] += is_one and depth < 0.0 and not row.self_collided
            if depth < 0.0:
                pairs[pair] += 1
    names = ["episodes", "spheres", "meshes", "deep", "meshes alone", "successes"]
    names += [f"successes, {name}" for name in ("spheres", "meshes", "deep")]
    print("| policy | task | " + " | ".join(names) + " |")
    print("|---|---|" + "---:|" * len(names))
    for (policy, task), count in counts.items():
        print(f"| {policy} | {task} | " + " | ".join(str(count[name]) for name in names) + " |")
    print()
    for pair, count in sorted(pairs.items(), key=lambda item: -item[1]):
        print(f"{pair}: deepest in {count} episodes")


if __name__ == "__main__":
    main()
