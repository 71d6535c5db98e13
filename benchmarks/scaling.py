"""Cost of a control step of the whole world against batch size and number of obstacles.

    python benchmarks/scaling.py [--out docs/scaling.png]

Writes a plot and prints Markdown tables. On a GPU the batch goes to 4096.
"""

import argparse
from dataclasses import replace
from pathlib import Path

import jax
import numpy as np
from world_loop import WorldLoop, batch_of, most_obstacles

from drpbench.compile import use_cache
from drpbench.contract import Problem
from drpbench.evaluation.machine import device_name
from drpbench.problems import TaskProblems, load_set

STEPS = 50  # control steps a repetition


def with_obstacles(problem: Problem, count: int) -> Problem:
    """The same problems with their first `count` obstacles."""
    fewer = jax.tree.map(lambda leaf: leaf[:, :count], problem.obstacles)
    return replace(problem, obstacles=fewer)


def crowded(problems: TaskProblems, batch: int) -> Problem:
    """A batch of the problems with the most obstacles; all 24 places are taken in each.

    Where a problem has fewer, its first ones stand a second time where they are: it costs the same.
    """
    problem = batch_of(problems, most_obstacles(problems, 16), batch)
    there = problem.obstacles.mask.sum(axis=1, keepdims=True)
    place = np.arange(24)[None] % there
    rows = np.arange(batch)[:, None]
    return replace(
        problem, obstacles=jax.tree.map(lambda leaf: leaf[rows, place], problem.obstacles)
    )


def median_cost(loop: WorldLoop, repetitions: int) -> float:
    """Median time [µs] of one control step of one world."""
    return 1e6 / float(np.median([loop.rate() for _ in range(repetitions)]))


def measure(task: str, batches: list[int], counts: list[int], batch: int, repetitions: int):
    """Costs [µs] by batch size, with every obstacle, and by number of obstacles at batch
    `batch`."""
    problems = load_set().task(task)
    by_batch = [
        median_cost(WorldLoop(task, crowded(problems, size), STEPS), repetitions)
        for size in batches
    ]
    full = crowded(problems, batch)
    by_count = [
        median_cost(WorldLoop(task, with_obstacles(full, count), STEPS), repetitions)
        for count in counts
    ]
    return by_batch, by_count


def draw(out: Path, batches, by_batch, counts, by_count, batch: int) -> None:
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    style = {"color": "#1f4e79", "marker": "o", "markersize": 5, "linewidth": 1.8}
    figure, (left, right) = pyplot.subplots(1, 2, figsize=(9.0, 3.4), layout="constrained")
    left.loglog(batches, by_batch, **style)
    left.set_xticks(batches, [str(size) for size in batches])
    left.minorticks_off()
    left.set(xlabel="worlds in a batch", ylabel="a control step of one world [µs]")
    left.set_title("24 obstacles", fontsize=10)
    low, high = min(by_batch), max(by_batch)
    low, high = low / 1.15, high * 1.15
    shares = (1, 1.5, 2, 3, 4, 5, 7) if high < 10 * low else (1, 2, 5)
    ticks = [t for e in range(8) for share in shares if low <= (t := share * 10**e) <= high]
    left.set_ylim(low, high)
    left.set_yticks(ticks, [f"{tick:g}" for tick in ticks])
    right.plot(counts, by_count, **style)
    right.set_xticks(counts)
    right.set_ylim(0.0, 1.1 * max(by_count))
    right.set(xlabel="obstacles", ylabel="a control step of one world [µs]")
    right.set_title(f"batch of {batch}", fontsize=10)
    for axes in (left, right):
        axes.grid(alpha=0.25)
        axes.spines[["top", "right"]].set_visible(False)
    figure.suptitle(device_name(), fontsize=10)
    out.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(out, dpi=160)


def table(title: str, values: list[int], costs: list[float]) -> None:
    print(f"\n| {title} | µs a control step of one world | control steps/s |\n|---|---|---|")
    for value, cost in zip(values, costs, strict=True):
        print(f"| {value} | {cost:.1f} | {1e6 / cost:,.0f} |")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    on_gpu = jax.default_backend() == "gpu"
    batches = [1, 4, 16, 64, 256, 1024] + ([4096] if on_gpu else [])
    parser.add_argument("--task", default="SE")
    parser.add_argument("--batches", type=int, nargs="+", default=batches)
    parser.add_argument("--obstacles", type=int, nargs="+", default=[1, 2, 4, 8, 16, 24])
    parser.add_argument("--batch", type=int, default=4096 if on_gpu else 256, help="of the second")
    parser.add_argument("--repetitions", type=int, default=5)
    parser.add_argument("--out", type=Path, default=Path("docs/scaling.png"))
    arguments = parser.parse_args()
    use_cache()
    by_batch, by_count = measure(
        arguments.task,
        arguments.batches,
        arguments.obstacles,
        arguments.batch,
        arguments.repetitions,
    )
    print(f"{device_name()}, jax {jax.__version__}, task {arguments.task}")
    table("worlds in a batch, 24 obstacles", arguments.batches, by_batch)
    table(f"obstacles, batch of {arguments.batch}", arguments.obstacles, by_count)
    draw(
        arguments.out,
        arguments.batches,
        by_batch,
        arguments.obstacles,
        by_count,
        arguments.batch,
    )


if __name__ == "__main__":
    main()
