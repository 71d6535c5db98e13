"""The leaderboard: every figure recomputed from the rows of result files.

Pure data; `tables` shows it in a terminal, `markdown` as text, `export` as CSV and JSON.
"""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path

from drpbench.errors import DrpbenchError
from drpbench.results import Header, Result, Row, load
from drpbench.results.names import forms, is_result
from drpbench.results.shipped import shipped_results

from .depth import LIGHT_DEPTH, successes_by_depth
from .markdown import render_markdown
from .statistics import Paired, paired, wilson

SHIPPED = "shipped: "  # before the names of results that stand beside a user's own
MOST_LEFT_OUT = 0.1
"""Share of a task's rows that may be left out before a run counts as partial."""


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
        by_deadline: at the goal at the last step before the boxes vanish, without a collision so
            far; of the tasks in which some do.
        light: reached, and no contact of more than 1 N (`LIGHT_DEPTH`).
        clean: success, and never touched itself by its spheres.
        left_out: rows not valid (SAO, GB: no box came), in no denominator.
        partial: fewer rows than there are problems, or more than a tenth of them left out.
    """

    success: Rate
    reached: Rate
    reached_5cm: Rate
    collided: Rate
    by_deadline: Rate
    light: Rate
    clean: Rate
    left_out: int
    partial: bool


@dataclass(frozen=True)
class Entry:
    """One policy's line.

    Attributes:
        rank: 1 for the best; None for a partial run, which has none.
        about: what the policy is, where its name does not say all; from its results' headers.
        seed: of the run; what is of several seeds is several entries.
        cells: by task, for the tasks it was run on.
        overall: over all its rows.
        rows: what it was counted from.
    """

    policy: str
    rank: int | None
    about: str
    privileged: bool
    seed: int
    cells: Mapping[str, Cell]
    overall: Cell
    rows: tuple[Row, ...]

    def against(self, other: Entry) -> Paired:
        """McNemar's test on the instances that both have: of another seed, none."""
        return paired(self.rows, other.rows if other.seed == self.seed else ())


@dataclass(frozen=True)
class Leaderboard:
    """Whole runs from the highest overall success share to the lowest, then partial ones in the
    same way; ties by name.

    All are of one version of the protocol; `others` counts the results of each other version, which
    are left out.
    """

    problem_set: str
    problem_set_sha256: str
    protocol: int
    others: Mapping[int, int]
    tasks: tuple[str, ...]
    entries: tuple[Entry, ...]
    own: frozenset[str] = frozenset()
    """The entries that are not shipped, where shipped ones stand beside them."""

    def __str__(self) -> str:
        """The tables as Markdown."""
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


def of_protocol(
    results: Mapping[str, Result], expected: Mapping[str, int], protocol: int | None
) -> dict[str, Result]:
    """Those of one version of the protocol, unless one is named: the newest of which there is a
    whole run, or, where no run is whole, the newest.

    Raises LeaderboardError where there is none.
    """
    versions = sorted({result.header.protocol for result in results.values()})
    if not versions:
        raise LeaderboardError("no result to compare")
    if protocol is None:
        whole = (
            v for v in reversed(versions) if len(versions) > 1 and _whole(results, expected, v)
        )
        protocol = next(whole, versions[-1])
    if protocol not in versions:
        there = ", ".join(map(str, versions))
        raise LeaderboardError(f"expected results of protocol {protocol}, got those of {there}")
    return {name: one for name, one in results.items() if one.header.protocol == protocol}


def _whole(results: Mapping[str, Result], expected: Mapping[str, int], protocol: int) -> bool:
    """Whether there is a whole run of this version."""
    rows = _by_policy(labelled(of_protocol(results, expected, protocol)))
    return any(not _partial(found, expected) for found in rows.values())


def labelled(results: Mapping[str, Result]) -> dict[str, Result]:
    """The results, their header's policy being what each is called: its own name, or its policy.

    Files that are called the same are taken together where they are of different tasks and of equal
    parameters; else each is also called by its file.
    """
    groups: dict[str, list[str]] = {}
    for name, result in results.items():
        groups.setdefault(result.header.called, []).append(name)
    found = {}
    for label, names in groups.items():
        headers = [results[name].header for name in names]
        apart = any(difference(one, other) for one, other in combinations(headers, 2))
        for name, header in zip(names, headers, strict=True):
            called = f"{label} ({_stem(name)})" if apart else label
            found[name] = results[name].model_copy(
                update={"header": header.model_copy(update={"policy": called})}
            )
    return {name: found[name] for name in results}


def difference(one: Header, other: Header) -> str:
    """Why two files cannot be of one entry; empty if they can."""
    for field in ("protocol", "policy", "policy_parameters", "privileged", "seed"):
        first, second = getattr(one, field), getattr(other, field)
        if first != second:
            told = "" if field == "policy_parameters" else f" {first} and {second}"
            return f"two of {field.replace('_', ' ')}{told}"
    shared = [task for task in one.tasks if task in other.tasks]
    return f"both of {', '.join(shared)}" if shared else ""


def _stem(name: str) -> str:
    return Path(name).name.removesuffix(".gz").removesuffix(".json")


def beside(own: Mapping[str, Result], shipped: Mapping[str, Result]) -> dict[str, Result]:
    """Of the shipped results, the rows whose instances are among `own` too, for comparison: `own`
    are of one protocol. What is called as one of `own` is marked.

    An instance is a problem and a seed: another seed has other boxes.
    """
    worlds = {_world(result.header) for result in own.values()}
    ids = {row.key for result in own.values() for row in result.rows}
    called = {result.header.called for result in own.values()}
    found = {}
    for name, result in shipped.items():
        header = result.header
        if _world(header) not in worlds:
            continue
        rows = [row for row in result.rows if row.key in ids]
        if not rows:
            continue
        tasks = [task for task in header.tasks if any(row.task == task for row in rows)]
        problems = {task: [row.id for row in rows if row.task == task] for task in tasks}
        label = f"{header.policy}, shipped" if header.policy in called else header.name
        changes = {"tasks": tasks, "problems": problems, "name": label}
        found[SHIPPED + name] = Result(header=header.model_copy(update=changes), rows=rows)
    return found


def _world(header: Header) -> tuple[str, int, int]:
    return header.problem_set_sha256, header.protocol, header.seed


def require_same(results: Mapping[str, Result], fields: Sequence[str]) -> None:
    """Raises LeaderboardError where the headers of two results differ in one of the fields."""
    (first, a), (second, b) = results.items()
    for field in fields:
        one, two = getattr(a.header, field), getattr(b.header, field)
        if one != two:
            raise LeaderboardError(
                f"{first} and {second}: expected runs of one {field}, got {str(one)[:40]} and "
                f"{str(two)[:40]}"
            )


def file_of(folder: Path, name: str) -> Path:
    """Where a result lies: in `folder`, or among those that come with drpbench."""
    return shipped_results() / name.removeprefix(SHIPPED) if is_shipped(name) else folder / name


def is_shipped(name: str) -> bool:
    """Whether this is what `beside` calls a result."""
    return name.startswith(SHIPPED)


def build(
    results: Mapping[str, Result], expected: Mapping[str, int], protocol: int | None = None
) -> Leaderboard:
    """Compares results on one problem set and of one protocol.

    Args:
        results: by the name a message should give them, usually the file's. Each is called as
            `labelled` has it.
        expected: number of problems of each task, in the order the tasks are shown.
        protocol: its version, by default as `of_protocol` has it; others are left out.

    Raises:
        LeaderboardError: there is nothing to compare, the problem sets differ, or a row belongs to
            no problem of the set.
    """
    everything, results = results, labelled(of_protocol(results, expected, protocol))
    _require_one_problem_set(results)
    headers: dict[str, Header] = {}
    for name, result in results.items():
        _require_known_problems(name, result, expected)
        headers.setdefault(result.header.policy, result.header)
    rows = _by_policy(results)

    overall = {policy: _cell(rows[policy], sum(expected.values())) for policy in rows}
    cells = {policy: _cells(rows[policy], expected) for policy in rows}
    partial = {policy: _partial(rows[policy], expected) for policy in rows}
    ranked = sorted(rows, key=lambda one: (partial[one], -overall[one].success.share, one))
    first = next(iter(headers.values()))
    seen = {row.task for policy in rows for row in rows[policy]}
    versions = Counter(result.header.protocol for result in everything.values())
    return Leaderboard(
        problem_set=first.problem_set,
        problem_set_sha256=first.problem_set_sha256,
        protocol=first.protocol,
        others={version: n for version, n in versions.items() if version != first.protocol},
        tasks=tuple(task for task in expected if task in seen),
        own=frozenset(
            result.header.policy for name, result in results.items() if not is_shipped(name)
        ),
        entries=tuple(
            Entry(
                policy=policy,
                rank=None if partial[policy] else place,
                about=headers[policy].about,
                privileged=headers[policy].privileged,
                seed=headers[policy].seed,
                cells=cells[policy],
                overall=overall[policy],
                rows=tuple(rows[policy]),
            )
            for place, policy in enumerate(ranked, start=1)
        ),
    )


def _by_policy(results: Mapping[str, Result]) -> dict[str, list[Row]]:
    rows: dict[str, list[Row]] = {}
    for result in results.values():
        rows.setdefault(result.header.policy, []).extend(result.rows)
    return rows


def _partial(rows: list[Row], expected: Mapping[str, int]) -> bool:
    """Whether a policy has no rank."""
    whole = _cell(rows, sum(expected.values()))
    return whole.partial or any(cell.partial for cell in _cells(rows, expected).values())


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
    valid = [row for row in rows if row.valid]
    met = [row for row in valid if row.success_before_removal is not None]
    left_out = len(rows) - len(valid)
    return Cell(
        success=_rate(row.success for row in valid),
        reached=_rate(row.reached for row in valid),
        reached_5cm=_rate(row.reached_5cm for row in valid),
        collided=_rate(row.collided for row in valid),
        by_deadline=_rate(bool(row.success_before_removal) for row in met),
        light=Rate(int(successes_by_depth(valid, [LIGHT_DEPTH])[0]), len(valid)),
        clean=_rate(row.success and not row.self_collided for row in valid),
        left_out=left_out,
        partial=len(rows) < problems or left_out > MOST_LEFT_OUT * len(rows),
    )


def _rate(verdicts: Iterable[bool]) -> Rate:
    counted = list(verdicts)
    return Rate(sum(counted), len(counted))


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


def _require_known_problems(name: str, result: Result, expected: Mapping[str, int]) -> None:
    for row in result.rows:
        if row.id >= expected.get(row.task, 0):
            raise LeaderboardError(
                f"{name}: {result.header.problem_set} has no problem {row.task} {row.id}"
            )
