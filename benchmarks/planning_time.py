"""Success of OMPL's planners against the time that they may take, as Markdown.

    pip install ompl
    python benchmarks/planning_time.py [--planners rrtconnect bitstar] [--seconds 0.1 0.3 1 3 10]
    [--problems 32] [--interpreter PYTHON]

The problems are a random sample of the frozen task SE; no setting of a policy is chosen on them.
Every path is judged by C MuJoCo's spheres along the whole of it. Planning only: nothing is tracked.
"""

import argparse
import time
from types import SimpleNamespace

import numpy as np

from drpbench.baselines import Ompl
from drpbench.baselines.forked import Lost
from drpbench.generation.certificate import certify
from drpbench.generation.generator import CHECKER_MARGIN
from drpbench.planning.checker import sphere_checker
from drpbench.planning.retiming import step_lengths
from drpbench.problems import load_set
from drpbench.ranking import wilson


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--planners", nargs="+", default=["rrtconnect", "bitstar"])
    parser.add_argument("--seconds", nargs="+", type=float, default=[0.1, 0.3, 1.0, 3.0, 10.0])
    parser.add_argument("--problems", type=int, default=32)
    parser.add_argument("--interpreter", default="")
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    problems = load_set().task("SE")
    drawn = np.random.default_rng(arguments.seed).choice(
        problems.count, arguments.problems, replace=False
    )
    ids = np.sort(drawn)
    obstacles, start, goal = problems.obstacles[ids], problems.start[ids], problems.goal[ids]
    seen = SimpleNamespace(obstacles=obstacles.primitives(), joint_position=start, goal_joints=goal)
    checker = sphere_checker(CHECKER_MARGIN)
    print(
        "| planner | seconds | solved | % | s a problem | length [s] |\n|---|---|---|---|---|---|"
    )
    for planner in arguments.planners:
        for seconds in arguments.seconds:
            policy = Ompl(planner, seconds, interpreter=arguments.interpreter)
            began = time.perf_counter()
            found = policy.paths(seen)
            taken = (time.perf_counter() - began) * policy.cores / len(ids)
            policy.close()
            lengths = []
            for i, path in enumerate(found):
                if isinstance(path, Lost):
                    continue
                checker.set_obstacles(obstacles[i])
                if certify(path, start[i], goal[i], checker, None).fault is None:
                    lengths.append(float(step_lengths(path).sum()))
            low, high = wilson(len(lengths), len(ids))
            print(
                f"| {planner} | {seconds:g} | {len(lengths)}/{len(ids)} | "
                f"{100 * len(lengths) / len(ids):.0f} [{100 * low:.0f}, {100 * high:.0f}] | "
                f"{taken:.2f} | {np.median(lengths) if lengths else float('nan'):.2f} |",
                flush=True,
            )


if __name__ == "__main__":
    main()
