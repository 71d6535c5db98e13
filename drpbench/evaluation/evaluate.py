"""Evaluating a policy from Python, as `drpbench run` does it."""

import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from io import StringIO
from pathlib import Path
from typing import Any

from rich.console import Console

from drpbench.contract import HostPolicy, Policy
from drpbench.errors import InputError
from drpbench.plugins.host import TIME_LIMIT
from drpbench.plugins.registry import at_hand
from drpbench.problems import ProblemSet, load_set
from drpbench.ranking import Leaderboard, build, load_dir, render_entry
from drpbench.results import Header, Result, Row, save
from drpbench.results.shipped import shipped_results
from drpbench.rollout import LANES

from .progress import Bars, RunProgress, Silent
from .run import Request, run

_RESULT = "result.json"


@dataclass(frozen=True)
class Evaluation:
    """What an evaluation found: one row for each problem, and what was run."""

    result: Result
    counts: Mapping[str, int]
    """Number of problems that the set has of each task."""

    @property
    def header(self) -> Header:
        """The policy, its parameters, the problems, seed and versions."""
        return self.result.header

    @property
    def rows(self) -> list[Row]:
        """The outcome of each problem, in the order in which they were run."""
        return self.result.rows

    def to_dicts(self) -> list[dict[str, Any]]:
        """The rows as plain dictionaries."""
        return [row.model_dump() for row in self.rows]

    def to_pandas(self) -> Any:
        """The rows as a `pandas.DataFrame`. Raises ImportError without pandas."""
        try:
            import pandas
        except ImportError:
            raise ImportError("to_pandas needs pandas: pip install pandas") from None
        return pandas.DataFrame(self.to_dicts())

    def summary(self) -> str:
        """Success, reach and collision by task: k/n, % and [95 % interval]."""
        text = StringIO()
        board = build({_RESULT: self.result}, self.counts)
        console = Console(file=text, width=100)
        console.print(render_entry(board.entries[0], console))
        return "\n".join(line.rstrip() for line in text.getvalue().splitlines())

    def save(self, path: str | Path) -> None:
        """Writes a result file for `drpbench leaderboard`, `submit` and `verify`; `.json.gz`
        compresses it.

        Raises ResultsError.
        """
        save(self.result, path)

    def __str__(self) -> str:
        return self.summary()


def evaluate(
    policy: str | Policy | HostPolicy,
    on: str | Sequence[str] | Path | ProblemSet = "all",
    problems: int | Sequence[int] | None = None,
    *,
    policy_arguments: Sequence[str] = (),
    seed: int = 0,
    batch_size: int = LANES,
    time_limit: float = TIME_LIMIT,
    out: str | Path | None = None,
    progress: bool | RunProgress = True,
) -> Evaluation:
    """Runs a policy on problems and judges every one of them.

    Args:
        policy: a name that `drpbench list` knows, an import path, or a policy itself: in JAX
            (`init` and `act`) or on the host (`reset` and `act`).
        on: a task ("FDO"), several (["FDO", "DGB"]) or "all" of the benchmark's; or a problem set,
            or the path of its file, with all of its tasks.
        problems: the first so many of each task, or their ids; None for all of them.
        policy_arguments: parameters of a named policy, each as "name=value".
        batch_size: episodes at once.
        time_limit: [s] that a policy on the host may take for a control step.
        out: keeps the result file there; without it nothing is left on the disk.
        progress: whether a bar is shown, or what is told of the run instead.

    Raises:
        DrpbenchError: an argument, the policy or the set is not as expected; the message is one
            line.
    """
    problem_set, tasks = _chosen(on)
    choice = at_hand(policy, time_limit, problem_set.robot) if not isinstance(policy, str) else None
    name = policy if isinstance(policy, str) else type(policy).__name__
    with _result_file(out) as path:
        request = Request(
            policy=name,
            choice=choice,
            problems={task: _ids(problems, task, problem_set.counts[task]) for task in tasks},
            problem_set=problem_set,
            out=path,
            policy_arguments=policy_arguments,
            time_limit=time_limit,
            seed=seed,
            batch_size=batch_size,
        )
        with _shown(progress, name) as told:
            result = run(request, told)
    return Evaluation(result, problem_set.counts)


def leaderboard(folder: str | Path | None = None) -> Leaderboard:
    """The leaderboard of a folder of result files, or of the shipped ones; print it, or look at its
    entries.

    Raises LeaderboardError or ResultsError.
    """
    return build(load_dir(shipped_results() if folder is None else folder), load_set().counts)


def _chosen(on: str | Sequence[str] | Path | ProblemSet) -> tuple[ProblemSet, tuple[str, ...]]:
    if isinstance(on, ProblemSet):
        return on, on.tasks
    if isinstance(on, Path) or (isinstance(on, str) and on.endswith(".jsonl")):
        problem_set = load_set(on)
        return problem_set, problem_set.tasks
    problem_set = load_set()
    if on == "all":
        return problem_set, problem_set.tasks
    tasks = (on,) if isinstance(on, str) else tuple(on)
    for task in tasks:
        problem_set.task(task)  # says which there are
    return problem_set, tasks


def _ids(problems: int | Sequence[int] | None, task: str, count: int) -> list[int] | None:
    if problems is None:
        return None
    if not isinstance(problems, int):
        return list(problems)
    if not 1 <= problems <= count:
        raise InputError(f"problems={problems}: expected 1 to {count}, which is what {task} has")
    return None if problems == count else list(range(problems))


@contextmanager
def _result_file(out: str | Path | None) -> Iterator[Path]:
    if out is not None:
        yield Path(out)
        return
    with tempfile.TemporaryDirectory(prefix="drpbench-") as folder:
        yield Path(folder) / _RESULT


@contextmanager
def _shown(progress: bool | RunProgress, policy: str) -> Iterator[RunProgress]:
    if progress is True:
        with Bars(Console(markup=False, highlight=False), policy) as bars:
            yield bars
    else:
        yield Silent() if progress is False else progress
