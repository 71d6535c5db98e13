"""What a report costs: time to read and check result files, time to write the page, and its size;
time and size of a picture of a failure. Markdown.

    python benchmarks/report.py [--rows 50000] [--pictures 12]

The rows are synthetic: policies on the whole benchmark, each row with verdicts and errors drawn at
random, in files as a run writes them. The pictures are of failures of `straight` in FDO, from saved
trajectories.
"""

import argparse
import tempfile
import time
from pathlib import Path

import numpy as np

from drpbench.evaluation import Request, run
from drpbench.evaluation.progress import Silent
from drpbench.problems import load_set
from drpbench.ranking import load_dir
from drpbench.report.page import write_report
from drpbench.report.pictures import pictures
from drpbench.results import Header, Result, Row, save
from drpbench.results.schema import VERSIONED
from drpbench.robot import PANDA

PERIOD = 1 / 60  # [s]


def row(rng: np.random.Generator, task: str, id: int, family: str) -> Row:
    """An outcome without meaning, whose fields agree."""
    collided, reached = rng.random() < 0.4, rng.random() < 0.6
    return Row(
        id=id,
        task=task,
        family=family,
        success=reached and not collided,
        reached=reached,
        reached_5cm=reached,
        reached_once=reached or rng.random() < 0.1,
        collided=collided,
        first_collision_step=int(rng.integers(1000)) if collided else None,
        first_collision_link=PANDA.link_names[rng.integers(1, len(PANDA.link_names))]
        if collided
        else None,
        self_collided=False,
        min_clearance=rng.uniform(-0.05, 0.0) if collided else rng.uniform(0.0, 0.2),
        position_error=rng.uniform(0.0, 0.01) if reached else rng.uniform(0.01, 1.0),
        orientation_error=rng.uniform(0.0, 0.2),
        time_to_goal=float(rng.integers(1, 1001)) * PERIOD if reached else None,
        joint_path_length=rng.uniform(1.0, 9.0),
        ee_path_length=rng.uniform(0.2, 3.0),
        sparc_joint=-rng.uniform(1.5, 9.0),
        sparc_ee=-rng.uniform(1.5, 9.0),
        joint_limit_violation=False,
    )


def result(rng: np.random.Generator, policy: str, instances: list[tuple[str, int, str]]) -> Result:
    """One policy on these instances: task, id, family."""
    ids: dict[str, list[int]] = {}
    for task, id, _ in instances:
        ids.setdefault(task, []).append(id)
    header = Header(
        policy=policy,
        policy_parameters={},
        privileged=False,
        tasks=list(ids),
        problem_set="drpbench-v1",
        problem_set_sha256="0" * 64,
        seed=0,
        precision="float32",
        device="none",
        batch_size=64,
        versions=dict.fromkeys(VERSIONED, "0"),
        platform="none",
        created="2025-01-01T00:00:00Z",
        problems=ids,
        wall_seconds=0.0,
    )
    return Result(header=header, rows=[row(rng, *instance) for instance in instances])


def report(wanted: int) -> None:
    """Times a report on so many rows."""
    rng = np.random.default_rng(0)
    sizes = load_set().counts
    families = {task: load_set().task(task).family for task in sizes}
    whole = [(task, id, families[task][id]) for task in sizes for id in range(sizes[task])]
    with tempfile.TemporaryDirectory() as name:
        folder, page = Path(name), Path(name) / "report.html"
        for policy, first in enumerate(range(0, wanted, len(whole))):
            part = whole[: wanted - first]
            save(result(rng, f"policy-{policy}", part), folder / f"policy-{policy}.json")
        start = time.perf_counter()
        results = load_dir(folder)
        read = time.perf_counter()
        write_report(page, results, sizes, folder)
        wrote = time.perf_counter()
        print("| rows | policies | reading and checking | writing the page | together | its size |")
        print("|---:|---:|---:|---:|---:|---:|")
        print(
            f"| {wanted:,} | {len(results)} | {read - start:.1f} s | {wrote - read:.1f} s |"
            f" {wrote - start:.1f} s | {page.stat().st_size / 1e6:.2f} MB |"
        )


def draw(count: int) -> None:
    """Times so many pictures, the first time and once more."""
    with tempfile.TemporaryDirectory() as name:
        out = Path(name) / "straight.json"
        ids = list(range(min(2 * count, load_set().counts["FDO"])))  # four in five are failures
        request = Request("straight", {"FDO": ids}, out, save_trajectories=True)
        results = {out.name: run(request, Silent())}
        print("\n| pictures | in all | each, the second time | size of each, in the page |")
        print("|---:|---:|---:|---:|")
        times = []
        for _ in range(2):
            start = time.perf_counter()
            drawn = pictures(results, out.parent, count, False, print)
            times.append(time.perf_counter() - start)
        size = np.mean([len(picture) for picture in drawn.values()])
        each = 1e3 * times[1] / len(drawn)
        print(f"| {len(drawn)} | {times[0]:.1f} s | {each:.0f} ms | {size / 1e3:.1f} kB |")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rows", type=int, default=50_000)
    parser.add_argument("--pictures", type=int, default=12)
    arguments = parser.parse_args()
    report(arguments.rows)
    draw(arguments.pictures)


if __name__ == "__main__":
    main()
