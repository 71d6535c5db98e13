"""Makes a frozen problem set: `drpbench/problems/data/drpbench-v1.npz` and its manifest.

    DRPBENCH_MESHES=<folder of the real meshes> python scripts/freeze_problems.py
    DRPBENCH_MESHES=<folder of the real meshes> python scripts/freeze_problems.py --name NAME

Finished problems are kept in shards under `--shards`, so that a run that was cut off goes on where
it stopped. A shard belongs to one state of the generator and the spheres: when either changes, the
work starts anew. `--provisional N` makes a small set of the first N problems of each task.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import multiprocessing
import os
import time
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from drpbench.generation import generator, mpinets_like
from drpbench.generation.composition import COMPOSITION, Group, group_of, size_of

ROOT = Path(__file__).resolve().parent.parent
SHARD = 25  # problems in a shard
_generator = None  # one a process


@dataclass(frozen=True)
class Recipe:
    """What a set is made of."""

    tasks: Mapping[str, int]
    """How many problems of each."""
    groups: Callable[[str, int], Group]
    stream: str
    ground: bool
    how: Mapping[str, Any] = field(default_factory=dict)
    """What the generator is given."""


RECIPES = {
    "drpbench-v1": Recipe(
        {task: size_of(task) for task in COMPOSITION}, group_of, generator.BENCHMARK_STREAM, True
    ),
    mpinets_like.NAME: Recipe(
        {"SE": mpinets_like.SIZE},
        mpinets_like.group_of,
        mpinets_like.NAME,
        False,
        {
            "families": mpinets_like.FAMILIES,
            "groups": mpinets_like.group_of,
            "keep_straight": 1.0,
        },
    ),
}


def fingerprint() -> str:
    """Digest of all that decides what is generated: the generator's source and the arm's model."""
    package = ROOT / "drpbench"
    arm = package / "robot" / "arms" / "panda"
    paths = [arm / "arm.xml", arm / "spheres.json", arm / "__init__.py"]
    paths += sorted((package / "generation").rglob("*.py"))
    paths += sorted((package / "planning").glob("*.py"))
    digest = hashlib.sha256()
    for path in paths:
        digest.update(path.read_bytes())
    return digest.hexdigest()[:12]


def make_shard(job: tuple[str, str, int, int, Path]) -> Path:
    """Generates problems `first` to `last` of a task into a shard, unless it is there already."""
    global _generator
    name, task, first, last, folder = job
    recipe = RECIPES[name]
    path = folder / f"{task}-{first:05d}-{last:05d}.npz"
    if path.exists():
        return path
    if _generator is None:
        from drpbench.planning.checker import mesh_checker, sphere_checker
        from drpbench.robot import PANDA

        if (meshes := PANDA.meshes.find()) is None:
            raise SystemExit(f"certificates need the real meshes; {PANDA.meshes.absent}")
        _generator = generator.Generator(
            sphere_checker(generator.CHECKER_MARGIN), mesh_checker(meshes), **recipe.how
        )
    _generator.rejections.clear()
    drafts = [_generator.problem(task, index, recipe.stream) for index in range(first, last)]
    arrays = {
        "obstacle_count": np.array([d.scene.obstacles.count for d in drafts], np.uint8),
        "kind": np.concatenate([d.scene.obstacles.kind for d in drafts]).astype(np.uint8),
        "half_size": np.concatenate([d.scene.obstacles.half_size for d in drafts]),
        "position": np.concatenate([d.scene.obstacles.position for d in drafts]),
        "quaternion": np.concatenate([d.scene.obstacles.quaternion for d in drafts]),
        "start": np.stack([d.start for d in drafts]),
        "goal": np.stack([d.goal for d in drafts]),
        "goal_position": np.stack([d.goal_position for d in drafts]),
        "goal_quaternion": np.stack([d.goal_quaternion for d in drafts]),
        "family": np.array([d.group.family for d in drafts], "U12"),
        "pair": np.array([d.group.pair for d in drafts], "U2"),
        "level": np.array([d.group.level for d in drafts], np.uint8),
        "witness_count": np.array([len(d.witness) for d in drafts], np.uint8),
        "witness": np.concatenate([d.witness for d in drafts]),
        "attempts": np.array([d.attempts for d in drafts], np.uint16),
        "rejections": np.array(json.dumps(_generator.rejections)),
    }
    partial = path.with_suffix(f".{os.getpid()}.tmp")
    with partial.open("wb") as file:
        np.savez(file, **arrays)
    partial.rename(path)
    return path


def merge(paths: dict[str, list[Path]], name: str, out: Path, provisional: bool) -> None:
    """Joins the shards of all tasks and writes the set and its manifest."""
    arrays, tasks, rejections = {}, {}, Counter()
    for task, shards in paths.items():
        parts = [np.load(path, allow_pickle=False) for path in shards]
        for part in parts:
            rejections.update(json.loads(str(part["rejections"])))
        for key in parts[0].files:
            if key not in ("attempts", "rejections"):
                arrays[f"{task}_{key}"] = np.concatenate([part[key] for part in parts])
        attempts = int(sum(part["attempts"].sum() for part in parts))
        n = len(arrays[f"{task}_start"])
        groups = Counter(RECIPES[name].groups(task, index) for index in range(n))
        tasks[task] = {
            "count": n,
            "attempts": attempts,
            "groups": [
                {"family": g.family, "pair": g.pair, "level": g.level, "count": count}
                for g, count in groups.items()
            ],
        }
    out.mkdir(parents=True, exist_ok=True)
    data = out / f"{name}.npz"
    with data.open("wb") as file:
        np.savez_compressed(file, **arrays)
    manifest = {
        "name": name,
        "provisional": provisional,
        "sha256": hashlib.sha256(data.read_bytes()).hexdigest(),
        "generator_version": generator.GENERATOR_VERSION,
        "generator_fingerprint": fingerprint(),
        "seed": generator.VERSION_SEED,
        "stream": RECIPES[name].stream,
        "ground": RECIPES[name].ground,
        "made_with": {package: version(package) for package in ("numpy", "mujoco", "mink", "daqp")},
        "tasks": tasks,
        "rejected_attempts": dict(sorted(rejections.items())),
    }
    (out / f"{name}.json").write_text(json.dumps(manifest, indent=2) + "\n")
    print(f"{data}: {data.stat().st_size / 1e6:.2f} MB, sha256 {manifest['sha256']}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--name", choices=RECIPES, default="drpbench-v1")
    parser.add_argument("--out", type=Path, default=ROOT / "drpbench" / "problems" / "data")
    parser.add_argument("--shards", type=Path, default=ROOT / "build" / "problems")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--provisional", type=int, metavar="N", help="only N problems a task")
    arguments = parser.parse_args()
    made_from = fingerprint()
    folder = arguments.shards / arguments.name / made_from
    folder.mkdir(parents=True, exist_ok=True)
    jobs = []
    tasks = RECIPES[arguments.name].tasks
    for task, size in tasks.items():
        count = min(size, arguments.provisional or size)
        firsts = range(0, count, SHARD)
        jobs += [(arguments.name, task, i, min(i + SHARD, count), folder) for i in firsts]
    began, paths = time.monotonic(), {task: [] for task in tasks}
    with multiprocessing.get_context("spawn").Pool(arguments.workers) as pool:
        for done, path in enumerate(pool.imap(make_shard, jobs), 1):
            paths[path.name.split("-")[0]].append(path)
            print(f"{done}/{len(jobs)} shards, {time.monotonic() - began:.0f} s", flush=True)
    if fingerprint() != made_from:
        raise SystemExit("the generator or the spheres changed meanwhile; start again")
    merge(paths, arguments.name, arguments.out, provisional=arguments.provisional is not None)


if __name__ == "__main__":
    main()
