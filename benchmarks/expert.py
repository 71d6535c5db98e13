"""The expert against OMPL's RRT-Connect on the same problems, in the same run, as Markdown.

    pip install ompl
    python benchmarks/expert.py [--problems 64] [--set drpbench-v1 | training] [--batches 1 16 64]
    [--seed 0]

Problems are a random sample of the frozen task SE, or drawn anew from the training stream. Every
path is judged by the same independent check, C MuJoCo's spheres along the whole of it
(`drpbench.generation.certificate`). Both searches run on the host's processor, where JAX finds no
other device; a hint's own time is what the host's RRT-Connect takes to find and shorten it.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass, replace

import jax
import jax.numpy as jnp
import numpy as np

from drpbench.compile import use_cache
from drpbench.generation.certificate import certify
from drpbench.generation.generator import CHECKER_MARGIN, PATH_CLEARANCE
from drpbench.geometry import Obstacles, Primitives, stacked
from drpbench.planning.checker import Checker, sphere_checker
from drpbench.planning.expert import CHEAP, THOROUGH, PlannerSettings, planner
from drpbench.planning.retiming import step_lengths
from drpbench.planning.rrt_connect import Planner
from drpbench.problems import load_set
from drpbench.ranking import wilson
from drpbench.robot import PANDA

WIDTH = 24  # obstacle slots
HINT_WAYPOINTS = 24
MAX_CHECKS = 20_000  # of the host's RRT-Connect
SHORTCUTS = 60
OMPL_SECONDS = 5.0
OMPL_STEP = 0.02  # [rad] between two checked states


@dataclass(frozen=True)
class Sample:
    """n problems, obstacles padded to WIDTH."""

    obstacles: Obstacles
    start: np.ndarray
    goal: np.ndarray

    def into(self, checker: Checker, i: int) -> None:
        checker.set_obstacles(self.obstacles[i])

    def batch(self, ids: np.ndarray) -> tuple[Primitives, np.ndarray, np.ndarray]:
        return self.obstacles[ids].primitives(), self.start[ids], self.goal[ids]


def frozen(count: int, seed: int) -> Sample:
    """`count` random problems of drpbench-v1's task SE."""
    problems = load_set().task("SE")
    ids = np.sort(np.random.default_rng(seed).choice(problems.count, count, replace=False))
    return Sample(problems.obstacles[ids].padded(WIDTH), problems.start[ids], problems.goal[ids])


def drawn(count: int, seed: int) -> Sample:
    """`count` problems of the training stream whose goals are free."""
    from drpbench.generation.training_problems import Drawer

    drawer, found, number = Drawer(), [], 1_000_000 * (seed + 1)
    while len(found) < count:
        one = drawer.draw(number)
        number += 1
        if not one.obstructed:
            found.append(one)
    return Sample(
        stacked([one.obstacles for one in found]),
        np.stack([one.start for one in found]),
        np.stack([one.goal for one in found]),
    )


def by_host(sample: Sample, checker: Checker, seed: int) -> tuple[list, np.ndarray]:
    """A path or None for each problem, by the host's RRT-Connect with shortcuts, and the seconds
    each took."""
    paths, seconds = [], []
    for i in range(len(sample.start)):
        sample.into(checker, i)
        start, goal = sample.start[i].astype(float), sample.goal[i].astype(float)
        rng = np.random.default_rng([seed, i])
        began = time.perf_counter()
        host = Planner(checker, PATH_CLEARANCE)
        path = host.plan(rng, start, goal, MAX_CHECKS)
        if path is not None:
            path = host.shortcut(rng, path, SHORTCUTS)
        seconds.append(time.perf_counter() - began)
        paths.append(path)
    return paths, np.array(seconds)


def hints(sample: Sample, paths: list) -> np.ndarray:
    """(n, 1, HINT_WAYPOINTS, 7): the paths, or the straight line for what is None or has too many
    bends."""
    given = []
    for i, path in enumerate(paths):
        if path is None or len(path) > HINT_WAYPOINTS:
            path = np.stack([sample.start[i], sample.goal[i]])
        given.append(np.concatenate([path, np.repeat(path[-1:], HINT_WAYPOINTS - len(path), 0)]))
    return np.stack(given).astype(np.float32)[:, None]


def by_ompl(sample: Sample, checker: Checker, seed: int) -> tuple[list, np.ndarray]:
    """A path or None for each problem, by OMPL's RRT-Connect and its path simplification."""
    try:
        from ompl import base, geometric, util
    except ImportError:
        raise SystemExit("this benchmark needs OMPL: pip install ompl") from None
    util.setLogLevel(util.LogLevel.LOG_ERROR)
    util.RNG.setSeed(seed + 1)
    paths, seconds = [], []
    for i in range(len(sample.start)):
        sample.into(checker, i)
        space, bounds = base.RealVectorStateSpace(7), base.RealVectorBounds(7)
        for joint in range(7):
            bounds.setLow(joint, float(PANDA.joint_lower[joint]))
            bounds.setHigh(joint, float(PANDA.joint_upper[joint]))
        space.setBounds(bounds)
        setup = geometric.SimpleSetup(space)
        ends = [space.allocState(), space.allocState()]
        for state, q in zip(ends, (sample.start[i], sample.goal[i]), strict=True):
            for joint in range(7):
                state[joint] = float(q[joint])

        def free(state):
            return (
                checker.clearance(np.array([state[k] for k in range(7)])) >= PATH_CLEARANCE - 1e-5
            )

        setup.setStateValidityChecker(free)
        information = setup.getSpaceInformation()
        information.setStateValidityCheckingResolution(OMPL_STEP / space.getMaximumExtent())
        setup.setStartAndGoalStates(*ends)
        setup.setPlanner(geometric.RRTConnect(information))
        began = time.perf_counter()
        setup.solve(OMPL_SECONDS)
        if setup.haveExactSolutionPath():
            setup.simplifySolution()
            states = setup.getSolutionPath().getStates()
            paths.append(np.array([[state[k] for k in range(7)] for state in states]))
        else:
            paths.append(None)
        seconds.append(time.perf_counter() - began)
    return paths, np.array(seconds)


def by_expert(
    sample: Sample, settings: PlannerSettings, given: np.ndarray | None, batch: int, seed: int
):
    """Plans for all problems, `batch` at a time, and the seconds a problem; compiling left out."""
    compiled, count = planner(settings), len(sample.start)
    keys = jax.random.split(jax.random.key(seed), count)
    parts, seconds = [], []
    for first in [0, *range(0, count, batch)]:
        ids = np.arange(first, first + batch) % count
        arguments = (*sample.batch(ids), keys[ids], None if given is None else given[ids])
        began = time.perf_counter()
        parts.append(jax.tree.map(np.asarray, compiled(*arguments)))
        seconds.append((time.perf_counter() - began) / batch)
    plans = jax.tree.map(lambda *leaves: np.concatenate(leaves)[:count], *parts[1:])
    return plans, float(np.median(seconds[1:]))


def row(name: str, sample: Sample, checker: Checker, paths: list, seconds: float) -> str:
    """One line of the table. `paths` holds None where the planner itself says that it failed."""
    solved, wrong, lengths, rooms = 0, 0, [], []
    for i, path in enumerate(paths):
        if path is None:
            continue
        sample.into(checker, i)
        path = np.asarray(path, float)
        path[0], path[-1] = sample.start[i], sample.goal[i]
        proof = certify(path, path[0], path[-1], checker, None)
        solved += proof.fault is None
        wrong += proof.fault is not None
        if proof.fault is None:
            lengths.append(float(step_lengths(jnp.asarray(path, jnp.float32)).sum()))
            rooms.append(proof.sphere_clearance)
    low, high = wilson(solved, len(paths))
    return (
        f"| {name} | {solved}/{len(paths)} | {100 * solved / len(paths):.1f} "
        f"[{100 * low:.1f}, {100 * high:.1f}] | {wrong} | {seconds:.3f} | "
        f"{np.mean(lengths):.2f} | {1000 * np.median(rooms):.0f} |"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--problems", type=int, default=64)
    parser.add_argument("--set", choices=("drpbench-v1", "training"), default="drpbench-v1")
    parser.add_argument("--batches", type=int, nargs="+", default=[1, 16, 64])
    parser.add_argument("--thorough", action="store_true", help="also the expert without hints")
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    use_cache()
    take = frozen if arguments.set == "drpbench-v1" else drawn
    sample = take(arguments.problems, arguments.seed)
    checker = sphere_checker(CHECKER_MARGIN)

    print(f"{arguments.problems} problems, {arguments.set}, {jax.devices()[0].device_kind}\n")
    print(
        "| planner | certified | % [95 %] | claimed wrongly | s a problem | length [s] | room "
        "[mm] |"
    )
    print("|---|---|---|---|---|---|---|")
    paths, seconds = by_ompl(sample, checker, arguments.seed)
    print(row("OMPL RRT-Connect, simplified", sample, checker, paths, float(seconds.mean())))
    paths, seconds = by_host(sample, checker, arguments.seed)
    print(row("the host's RRT-Connect: the hints", sample, checker, paths, float(seconds.mean())))
    given = hints(sample, paths)
    runs = [("line and hint", CHEAP, given, batch) for batch in arguments.batches]
    if arguments.thorough:
        # Only what reaches the goal counts here.
        without_hints = replace(THOROUGH, stop_short=False)
        name = f"line and {THOROUGH.vias} via points"
        runs.append((name, without_hints, None, max(arguments.batches)))
    for name, settings, hint, batch in runs:
        plans, seconds = by_expert(sample, settings, hint, batch, arguments.seed)
        paths = [path if ok else None for path, ok in zip(plans.path, plans.reached, strict=True)]
        print(row(f"expert, {name}, batch {batch}", sample, checker, paths, seconds), flush=True)


if __name__ == "__main__":
    main()
