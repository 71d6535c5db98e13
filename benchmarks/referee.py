"""How often the benchmark's verdict and the real meshes in C MuJoCo agree, as Markdown.

    DRPBENCH_MESHES=FOLDER python benchmarks/referee.py [--problems 16] [--policies straight rmp]
    DRPBENCH_MESHES=FOLDER python benchmarks/referee.py --results drp.json

Runs each policy on problems spread over every task, with trajectories, or takes results of
`drpbench run --save-trajectories`, and has them judged: by the
meshes, and by the benchmark's own spheres in C MuJoCo, which tells a difference of shape from one
of engine.
"""

import argparse
import tempfile
from pathlib import Path

import numpy as np

from drpbench.compile import use_cache
from drpbench.evaluation import Request, run
from drpbench.evaluation.progress import Silent
from drpbench.evaluation.referee import (
    MARGIN,
    Agreement,
    Judgement,
    agreement,
    judge,
    judge_episode,
)
from drpbench.planning.checker import sphere_checker
from drpbench.problems import load_set
from drpbench.results import load
from drpbench.results.names import trajectories_file
from drpbench.results.trajectories import load_trajectories


def judged(policy: str, per_task: int, seed: int) -> tuple[list[Judgement], list[Judgement]]:
    """The policy on `per_task` problems of each task, spread evenly: judged by meshes, by
    spheres."""
    ids = {
        task: sorted({i * count // per_task for i in range(per_task)})
        for task, count in load_set().counts.items()
    }
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "run.json"
        run(
            Request(policy=policy, problems=ids, out=out, seed=seed, save_trajectories=True),
            Silent(),
        )
        return judged_again(out)


def judged_again(out: Path) -> tuple[list[Judgement], list[Judgement]]:
    """A recorded run: judged by meshes, by spheres."""
    result, recorded = load(out), load_trajectories(trajectories_file(out))
    problem_set, spheres = load_set(), sphere_checker(MARGIN)
    by_spheres = [
        judge_episode(row, recorded[f"{row.task}-{row.id}"], problem_set.task(row.task), spheres)
        for row in result.rows
    ]
    return judge(result, recorded, problem_set), by_spheres


def row(name: str, figures: Agreement) -> str:
    low, high = figures.interval
    missed = figures.deepest_missed
    return (
        f"| {name} | {figures.agreed}/{figures.episodes} | "
        f"{100 * figures.agreed / figures.episodes:.1f} % ({100 * low:.1f} to {100 * high:.1f}) | "
        f"{figures.both_free} | {figures.both_collided} | "
        f"{figures.episodes - figures.agreed} | "
        f"{f'{1e3 * missed.depth:.1f} mm' if missed else 'none'} |"
    )


def report(by_policy: dict[str, list[Judgement]]) -> None:
    everything = [j for judgements in by_policy.values() for j in judgements]
    print(
        "| episodes of | agree | share (95 %) | both free | both collided | differ | deepest "
        "missed |"
    )
    print("|---|---|---|---|---|---|---|")
    for policy, judgements in by_policy.items():
        for task in load_set().counts:
            print(
                row(f"{policy}, {task}", agreement([j for j in judgements if j.row.task == task]))
            )
    print(row("**all**", agreement(everything)))

    print("\n| disagreement | episodes |\n|---|---|")
    for name, count in agreement(everything).disagreements.items():
        print(f"| {name} | {count} |")

    both = [j for j in everything if j.collided and j.row.collided]
    if both:
        early = np.array([j.first_step - j.row.first_collision_step for j in both])
        print(
            f"\nWhere both saw a collision ({len(both)} episodes), the spheres saw it a median of "
            f"{np.median(early):g} control steps before the meshes (10 to 90 %: "
            f"{np.percentile(early, 10):g} to {np.percentile(early, 90):g}); the meshes' deepest "
            f"penetration had a median of {1e3 * np.median([j.depth for j in both]):.1f} mm."
        )

    print(
        "\n| differing episode | spheres | first | meshes | first | class "
        "|\n|---|---|---|---|---|---|"
    )
    for policy, judgements in by_policy.items():
        for j in judgements:
            if j.agrees:
                continue
            spheres = f"{1e3 * j.row.min_clearance:.1f} mm {j.row.first_collision_link or ''}"
            meshes = f"{1e3 * j.clearance:.1f} mm {j.closest_link or ''}"
            print(
                f"| {policy} {j.row.task}-{j.row.id} | {spheres} | "
                f"{_step(j.row.first_collision_step)}"
                f" | {meshes} | {_step(j.closest_step)} | {j.disagreement} |"
            )


def report_spheres(judgements: list[Judgement]) -> None:
    """How far the rows' clearance is from what MuJoCo finds for the same spheres."""
    near = [j for j in judgements if max(j.clearance, j.row.min_clearance or MARGIN) < MARGIN]
    off = [1e6 * abs(j.clearance - j.row.min_clearance) for j in near]
    print(
        f"\nThe spheres themselves in C MuJoCo: the same verdict in "
        f"{sum(j.agrees for j in judgements)} of {len(judgements)} episodes; the smallest "
        "clearance, "
        f"where it is under {1e3 * MARGIN:g} mm ({len(near)} episodes), differs by "
        f"{np.median(off):.2g} µm in the median and {max(off):.2g} µm at most."
    )


def _step(step: int | None) -> str:
    return "" if step is None else f"step {step}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--problems", type=int, default=16, help="of each task")
    parser.add_argument("--policies", nargs="+", default=["straight", "rmp"])
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--results", type=Path, nargs="+", help="instead of running policies")
    arguments = parser.parse_args()
    use_cache()
    if arguments.results:
        found = {load(path).header.policy: judged_again(path) for path in arguments.results}
    else:
        found = {p: judged(p, arguments.problems, arguments.seed) for p in arguments.policies}
    report({policy: by_meshes for policy, (by_meshes, _) in found.items()})
    report_spheres([j for _, by_spheres in found.values() for j in by_spheres])


if __name__ == "__main__":
    main()
