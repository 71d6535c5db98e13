"""What the frozen problem set holds: certificates, straight-line shares, distances, speed of a
check.

    DRPBENCH_MESHES=<folder of the real meshes> python benchmarks/problem_set.py

Checks the certificate of every problem anew and writes `benchmarks/problem_set.json`. "Straight" is
the share of problems of which the joint-space line from start to goal is free in the static scene.
"""

from __future__ import annotations

import argparse
import json
import time
from collections import defaultdict
from pathlib import Path

import numpy as np

from drpbench.generation import certificate
from drpbench.planning import motion
from drpbench.planning.checker import mesh_checker, sphere_checker
from drpbench.planning.rrt_connect import Planner
from drpbench.problems import load_set
from drpbench.robot import PANDA


def measure(task: str, spheres, meshes) -> tuple[dict[tuple[str, str, int], list[dict]], list[str]]:
    """Rows of figures by (family, pair, level), and the faults found."""
    problems = load_set().task(task)
    rows, faults = defaultdict(list), []
    for index in range(problems.count):
        scene = problems.obstacles[index]
        spheres.set_obstacles(scene)
        meshes.set_obstacles(scene)
        start, goal = problems.start[index].astype(float), problems.goal[index].astype(float)
        witness = problems.witness[index].astype(float)
        proof = certificate.certify(witness, start, goal, spheres, meshes)
        if proof.fault is not None:
            faults.append(f"{task} {index}: {proof.fault}")
        here, _ = spheres.grip_pose(start)
        rows[problems.family[index], problems.pair[index], int(problems.level[index])].append(
            {
                "straight_spheres": Planner(spheres, 0.0).straight(start, goal),
                "straight_meshes": Planner(meshes, 0.0).straight(start, goal),
                "distance": float(np.linalg.norm(problems.goal_position[index] - here)),
                "obstacles": int(scene.mask.sum()),
                "waypoints": len(witness),
                "detour": sum(map(motion.bound, witness[:-1], witness[1:]))
                / max(motion.bound(start, goal), 1e-9),
                "sphere_clearance": proof.sphere_clearance,
                "mesh_clearance": proof.mesh_clearance,
                "samples": proof.samples,
            }
        )
    return rows, faults


def summary(rows: list[dict]) -> dict:
    """Means and extremes over the problems of one group."""
    column = {key: np.array([row[key] for row in rows], float) for key in rows[0]}
    return {
        "problems": len(rows),
        "straight_spheres": round(float(column["straight_spheres"].mean()), 4),
        "straight_meshes": round(float(column["straight_meshes"].mean()), 4),
        "distance_mean_m": round(float(column["distance"].mean()), 3),
        "distance_least_m": round(float(column["distance"].min()), 3),
        "obstacles_mean": round(float(column["obstacles"].mean()), 1),
        "waypoints_mean": round(float(column["waypoints"].mean()), 1),
        "detour_median": round(float(np.median(column["detour"])), 2),
        "sphere_clearance_least_m": round(float(column["sphere_clearance"].min()), 4),
        "mesh_clearance_least_m": round(float(column["mesh_clearance"].min()), 4),
        "samples": int(column["samples"].sum()),
    }


def check_time(checker, repeats: int = 2000) -> float:
    """Median microseconds of a check over random configurations near the frozen scenes' starts."""
    problems, rng, times = load_set().task("SE"), np.random.default_rng(0), []
    for index in rng.choice(problems.count, min(20, problems.count), replace=False):
        checker.set_obstacles(problems.obstacles[index])
        for q in problems.start[index] + rng.normal(0, 0.3, (repeats // 20, 7)):
            began = time.perf_counter()
            checker.clearance(q)
            times.append(time.perf_counter() - began)
    return round(1e6 * float(np.median(times)), 1)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path(__file__).with_suffix(".json"))
    arguments = parser.parse_args()
    if (model := PANDA.meshes.find()) is None:
        raise SystemExit(f"certificates need the real meshes; {PANDA.meshes.absent}")
    spheres, meshes = sphere_checker(), mesh_checker(model)
    groups, faults, families = [], [], defaultdict(list)
    for task in load_set().tasks:
        rows, wrong = measure(task, spheres, meshes)
        faults += wrong
        for (family, pair, level), found in sorted(rows.items()):
            groups.append(
                {"task": task, "family": family, "pair": pair, "level": level, **summary(found)}
            )
            if task == "SE":
                families[family] += found
    report = {
        "problem_set": load_set().name,
        "sha256": load_set().sha256,
        "certificate_faults": faults,
        "check_microseconds": {"spheres": check_time(spheres), "meshes": check_time(meshes)},
        "SE_families": {family: summary(found) for family, found in sorted(families.items())},
        "SE": summary([row for found in families.values() for row in found]),
        "groups": groups,
    }
    arguments.out.write_text(json.dumps(report, indent=1) + "\n")
    print(
        "| task | family | pair | level | n | straight, spheres | straight, meshes | distance [m] |"
    )
    print("|---|---|---|---|---|---|---|---|")
    for g in groups:
        print(
            f"| {g['task']} | {g['family']} | {g['pair']} | {g['level']} | {g['problems']} "
            f"| {100 * g['straight_spheres']:.0f} % | {100 * g['straight_meshes']:.0f} % "
            f"| {g['distance_mean_m']:.2f} |"
        )
    for family, found in report["SE_families"].items():
        print(f"SE {family}: straight {100 * found['straight_spheres']:.1f} %")
    print(f"SE: straight {100 * report['SE']['straight_spheres']:.1f} %")
    print(f"a check: {report['check_microseconds']} microseconds")
    print(f"{len(faults)} certificates at fault", *faults[:20], sep="\n")


if __name__ == "__main__":
    main()
