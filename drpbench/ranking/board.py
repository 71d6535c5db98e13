"""The leaderboard: every figure recomputed from the rows of result files.

Pure data; :mod:`drpbench.ranking.tables` shows it.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from itertools import combinations, pairwise
from pathlib import Path

from drpbench.errors import DrpbenchError
from drpbench.results import Header, Result, Row, load
from drpbench.results.names import forms, is_result

from .statistics import Paired, paired, wilson


class LeaderboardError(DrpbenchError):
    """The results cannot stand on one leaderboard; the message is one line."""


@dataclass(frozen=True)
class Rate:
    """k of n instances, with Wilson's 95 % interval of the proportion."""

    k: int
    n: int

    @property
    def share(self) -> float:
        """k/n; 0 where there is no instance."""
        return self.k / self.n if self.n else 0.0

    @property
    def interval(self) -> tuple[float, float]:
        """Bounds of the proportion, within [0, 1]."""
        return wilson(self.k, self.n)


@dataclass(frozen=True)
class Cell:
    """One policy on one task, or on all of them.

    Attributes:
        success: reached and never collided.
        reached: within 1 cm and 15 degrees at the last step.
        reached_5cm: within 5 cm and 15 degrees at the last step.
        collided: touched an obstacle at any time.
        left_out: rows not valid (GB where the goal was never blocked), in no denominator.
        partial: fewer rows than there are problems.
    """

    success: Rate
    reached: Rate
    reached_5cm: Rate
    collided: Rate
    left_out: int
    partial: bool


@dataclass(frozen=True)
class Entry:
    """One policy's line.

    Attributes:
        cells: by task, for the tasks it was run on.
        overall: over all its rows.
        against_next: McNemar's test against the entry below; None for the last entry, and where
            the two share no instance.
    """

    policy: str
    privileged: bool
    cells: Mapping[str, Cell]
    overall: Cell
    against_next: Paired | None


@dataclass(frozen=True)
class Leaderboard:
    """Entries from the highest overall success share to the lowest, ties by name."""

    problem_set: str
    problem_set_sha256: str
    tasks: tuple[str, ...]
    entries: tuple[Entry, ...]

    def __str__(self) -> str:
        """The tables as Markdown."""
        from .tables import render_markdown

        return render_markdown(self)


def load_dir(folder: str | os.PathLike[str]) -> dict[str, Result]:
    """Reads every result file of a folder, by file name.

    Raises:
        ResultsError: a file is damaged (none is skipped).
        LeaderboardError: the folder is missing, holds no result file, or one both plain and
            compressed.
    """
    folder = Path(folder)
    if not folder.is_dir():
        told = (
            "expected a folder of result files, got a file" if folder.exists() else "no such folder"
        )
        raise LeaderboardError(f"{folder}: {told}")
    files = sorted(file for file in folder.iterdir() if is_result(file))
    if not files:
        raise LeaderboardError(f"{folder}: holds no result file (*.json or *.json.gz)")
    for plain, compressed in map(forms, files):
        if plain in files and compressed in files:
            raise LeaderboardError(
                f"{folder}: holds both {plain.name} and {compressed.name}; remove one"
            )
    return {file.name: load(file) for file in files}


def build(results: Mapping[str, Result], expected: Mapping[str, int]) -> Leaderboard:
    """Compares results on one problem set.

    Files of one policy on different tasks are taken together where policy parameters agree.

    Args:
        results: by the name a message should give them, usually the file's.
        expected: number of problems of each task, in the order the tasks are shown.

    Raises:
        LeaderboardError: there is nothing to compare, the problem sets differ, one policy stands
            twice, or a row belongs to no problem of the set.
    """
    if not results:
        raise LeaderboardError("no result to compare")
    _require_one_problem_set(results)
    rows: dict[str, list[Row]] = {}
    headers: dict[str, Header] = {}
    for one, other in combinations(results, 2):
        _require_no_conflict(one, results[one].header, other, results[other].header)
    for name, result in results.items():
        _require_known_problems(name, result, expected)
        headers.setdefault(result.header.policy, result.header)
        rows.setdefault(result.header.policy, []).extend(result.rows)

    ranked = sorted(rows, key=lambda policy: (-_rate(rows[policy], "success").share, policy))
    tests: dict[str, Paired] = {}
    for policy, below in pairwise(ranked):
        test = paired(rows[policy], rows[below])
        if test.shared:
            tests[policy] = test
    first = next(iter(headers.values()))
    seen = {row.task for policy in rows for row in rows[policy]}
    return Leaderboard(
        problem_set=first.problem_set,
        problem_set_sha256=first.problem_set_sha256,
        tasks=tuple(task for task in expected if task in seen),
        entries=tuple(
            Entry(
                policy=policy,
                privileged=headers[policy].privileged,
                cells=_cells(rows[policy], expected),
                overall=_cell(rows[policy], sum(expected.values())),
                against_next=tests.get(policy),
            )
            for policy in ranked
        ),
    )


def _cells(rows: list[Row], expected: Mapping[str, int]) -> dict[str, Cell]:
    by_task: dict[str, list[Row]] = {}
    for row in rows:
        by_task.setdefault(row.task, []).append(row)
    return {
        task: _cell(by_task[task], problems)
        for task, problems in expected.items()
        if task in by_task
    }


def _cell(rows: list[Row], problems: int) -> Cell:
    return Cell(
        success=_rate(rows, "success"),
        reached=_rate(rows, "reached"),
        reached_5cm=_rate(rows, "reached_5cm"),
        collided=_rate(rows, "collided"),
        left_out=sum(1 for row in rows if not row.valid),
        partial=len(rows) < problems,
    )


def _rate(rows: Iterable[Row], verdict: str) -> Rate:
    verdicts = [getattr(row, verdict) for row in rows if row.valid]
    return Rate(sum(verdicts), len(verdicts))


def _require_one_problem_set(results: Mapping[str, Result]) -> None:
    (first, result), *others = results.items()
    for other, another in others:
        for field in ("problem_set", "problem_set_sha256"):
            one, two = getattr(result.header, field), getattr(another.header, field)
            if one != two:
                raise LeaderboardError(
                    f"{first} and {other} were made on different problems and cannot be compared:"
                    f" {field} {one[:16]} and {two[:16]}"
                )


def _require_no_conflict(one: str, first: Header, other: str, second: Header) -> None:
    if first.policy != second.policy:
        return
    both = f"{one} and {other} both hold policy {first.policy}"
    if shared := [task for task in first.tasks if task in second.tasks]:
        raise LeaderboardError(f"{both} on {', '.join(shared)}; remove one")
    if (first.policy_parameters, first.privileged) != (second.policy_parameters, second.privileged):
        raise LeaderboardError(f"{both}, with different parameters; remove one")


def _require_known_problems(name: str, result: Result, expected: Mapping[str, int]) -> None:
    for row in result.rows:
        if row.id >= expected.get(row.task, 0):
            raise LeaderboardError(
                f"{name}: {result.header.problem_set} has no problem {row.task} {row.id}"
            )
