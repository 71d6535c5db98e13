"""Demonstrations without end: processes on the host draw problems, the expert solves them in
batches."""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import cache
from itertools import islice

import jax
import numpy as np

from drpbench.generation.training_problems import TRAINING_STREAM, Drawer, Drawn
from drpbench.geometry import stacked
from drpbench.planning.expert import CHEAP, planner
from drpbench.robot import PANDA, Robot

from .demonstrations import Demonstrations, Shards, join

# Problem numbers in a shard, at most: whole batches of the expert, on an accelerator too.
SHARD = 512


@dataclass(frozen=True)
class Problems:
    """The numbered problems of one stream, drawn in whatever process it is called in."""

    stream: str = TRAINING_STREAM
    robot: Robot = PANDA

    def __call__(self, number: int) -> Drawn:
        return _drawer(self).draw(number)


@cache
def _drawer(problems: Problems) -> Drawer:
    """One a process: it holds a compiled checker."""
    return Drawer(problems.stream, problems.robot)


def _without_accelerator() -> None:
    jax.config.update("jax_platforms", "cpu")  # the accelerator is the parent's


def batch_size() -> int:
    """How many problems the expert solves at once: what fills the device without keeping it
    waiting."""
    return 64 if jax.default_backend() == "cpu" else 512


def default_workers() -> int:
    """One process a core, and on a machine with many, one core left to the parent."""
    cores = (
        len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    )
    return max(1, cores - 1)


class Production:
    """Solved problems of one stream, by number, in order. A context manager: it owns processes."""

    def __init__(
        self,
        stream: str = TRAINING_STREAM,
        workers: int | None = None,
        robot: Robot = PANDA,
    ):
        self._problem = Problems(stream, robot)
        self._pool = ProcessPoolExecutor(
            workers or default_workers(),
            mp_context=multiprocessing.get_context("spawn"),
            initializer=_without_accelerator,
        )

    def __enter__(self) -> Production:
        return self

    def __exit__(self, *error: object) -> None:
        self._pool.shutdown(wait=True, cancel_futures=True)

    def solved(
        self, numbers: range, drawn_one: Callable[[], None] = lambda: None
    ) -> Iterator[Demonstrations]:
        """For each batch of `numbers` the problems that were solved. `drawn_one` is called after
        each problem that was drawn."""
        # A few batches ahead of the expert, no more.
        batch = batch_size()
        ahead = [self._pool.submit(self._problem, number) for number in numbers[: 4 * batch]]
        rest = iter(numbers[4 * batch :])
        while ahead:
            drawn = []
            for future in ahead[:batch]:
                drawn.append(future.result())
                drawn_one()
            more = [self._pool.submit(self._problem, number) for number in islice(rest, batch)]
            ahead = ahead[batch:] + more
            yield solve(drawn, self._problem.robot)


def solve(drawn: Sequence[Drawn], robot: Robot = PANDA) -> Demonstrations:
    """The expert's paths for those of up to `batch_size()` problems that it solves."""
    filled = [drawn[number % len(drawn)] for number in range(batch_size())]  # one compiled shape

    def stack(name: str) -> np.ndarray:
        return np.stack([getattr(one, name) for one in filled])

    obstacles = stacked([one.obstacles for one in filled])
    keys = jax.vmap(jax.random.key)(stack("index"))
    plans = planner(CHEAP, robot)(
        obstacles.primitives(), stack("start"), stack("goal"), keys, stack("hint")[:, None]
    )
    solved = np.nonzero(np.asarray(plans.success)[: len(drawn)])[0]
    return Demonstrations(
        index=stack("index")[solved],
        family=stack("family")[solved],
        obstacles=obstacles[solved],
        goal=stack("goal")[solved],
        path=np.asarray(plans.path)[solved],
        length=np.asarray(plans.length)[solved],
        reached=np.asarray(plans.reached)[solved],
    )


def fill(
    shards: Shards, numbers: range, workers: int | None, progress: Callable[[int, int], None]
) -> None:
    """Makes the shards of problem `numbers` that are not there yet.

    `progress(drawn, solved)` is called after every problem drawn, and after every batch solved.
    """
    missing = shards.missing(numbers, SHARD)
    progress(len(numbers) - sum(map(len, missing)), shards.solved(numbers))
    if not missing:
        return
    with Production(workers=workers) as production:
        for some in missing:
            parts = []
            for solved in production.solved(some, lambda: progress(1, 0)):
                parts.append(solved)
                progress(0, solved.count)
            shards.add(some, join(parts))
