"""Whether a result may stand on the leaderboard, and where it would.

The schema catches what contradicts itself within a row's verdict. Here is what needs more: the
problems themselves, the thresholds of the verdict, the entries there are.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import combinations

from drpbench.contract import (
    EPISODE,
    REACH_ORIENTATION,
    REACH_POSITION,
    REACH_POSITION_LOOSE,
)
from drpbench.envs import TASKS
from drpbench.problems import ProblemSet, ProblemSetError, load_set, matching
from drpbench.results import Header, Result, ResultsError, Row
from drpbench.robot import Robot

from .board import Entry, Leaderboard, build, difference
from .measures import ALL, cell_of

# Rows hold six digits, so what is this much (relatively) off a threshold may be on either side.
_ROUNDED = 1e-5


@dataclass(frozen=True)
class Standing:
    """A policy's place in one task, or in All: one more than the entries with a higher success
    rate.

    Only whole runs have places: it is None for a partial one, and where no row is valid.
    """

    task: str
    place: int | None
    of: int
    ahead: str | None
    """The entry next above, if there is one."""


@dataclass(frozen=True)
class Submission:
    """A correct result beside the entries there are."""

    entry: Entry
    standings: tuple[Standing, ...]
    missing: tuple[str, ...]
    """What a full entry has and this has not, a line each."""
    notes: tuple[str, ...]
    """What a reader of the leaderboard should know, a line each."""


def set_of(name: str, header: Header, given: ProblemSet | None = None) -> ProblemSet:
    """The problem set that a result was made on: `given`, or the one of its name in the package.

    Raises ResultsError, naming the result as `name`, where that is not it.
    """
    try:
        return matching(header.problem_set, header.problem_set_sha256, given)
    except ProblemSetError as error:
        raise ResultsError(f"{name}: {error}") from None


def check(name: str, result: Result, problem_set: ProblemSet | None = None) -> None:
    """Raises ResultsError, naming file, row and field, where a result contradicts its problems or
    itself.

    `problem_set` is the one that it was made on, where that does not come with the package. For the
    schema alone, `drpbench.results.schema.load`.
    """
    header = result.header
    problems = set_of(name, header, problem_set)
    sizes = problems.counts
    if unknown := [task for task in header.tasks if task not in sizes]:
        raise ResultsError(
            f"{name}: there is no task {unknown[0]}; the tasks are {', '.join(sizes)}"
        )
    for task, ids in header.problems.items():
        if outside := [id for id in ids or () if id >= sizes[task]]:
            raise ResultsError(
                f"{name}: no problem {outside[0]} in {task}; ids go from 0 to {sizes[task] - 1}"
            )
    for row in result.rows:
        fault: str | None
        if row.id >= sizes[row.task]:
            fault = f"there is no such problem; ids go from 0 to {sizes[row.task] - 1}"
        elif row.family != (family := problems.task(row.task).family[row.id]):
            fault = f"its family is {family}, not {row.family}"
        else:
            fault = _contradiction(row, problems.robot)
        if fault:
            raise ResultsError(f"{name}: {row.task} {row.id}: {fault}")


def _contradiction(row: Row, robot: Robot) -> str | None:
    """What in a row cannot have been measured; the schema has caught what is cruder."""
    last = EPISODE.duration
    if row.first_collision_step is not None and row.first_collision_step >= EPISODE.steps:
        return (
            f"first_collision_step is {row.first_collision_step} of {EPISODE.steps} control steps"
        )
    moving = robot.link_names[1:]
    if row.first_collision_link not in (None, *moving):
        return (
            f"first_collision_link is {row.first_collision_link!r}; "
            f"links that count: {moving[0]} to {moving[-1]}"
        )
    if row.collided != (row.min_clearance is not None and row.min_clearance < 0.0):
        return "min_clearance must be below zero exactly where collided is true"
    if row.time_to_goal is not None and not 0.0 < row.time_to_goal <= last * (1 + _ROUNDED):
        return f"time_to_goal is {row.time_to_goal} s of {last:.1f} s"
    if not row.valid:
        conditional = [name for name, task in TASKS.items() if task.conditional]
        if row.task not in conditional:
            return f"valid may be false only in {', '.join(conditional)}"
    if row.status == "ok":
        for name, limit in (("reached", REACH_POSITION), ("reached_5cm", REACH_POSITION_LOOSE)):
            if (within := _within(row, limit)) is not None and within != getattr(row, name):
                return (
                    f"{name} is {str(not within).lower()}, but the errors at the end are "
                    f"{row.position_error} m and {row.orientation_error} rad"
                )
    return None


def _within(row: Row, limit: float) -> bool | None:
    """Whether the final errors are below `limit` [m] and 15 degrees; None where rounding
    decides."""
    if row.position_error is None or row.orientation_error is None:
        return None
    shares = (row.position_error / limit, row.orientation_error / REACH_ORIENTATION)
    if any(abs(share - 1.0) <= _ROUNDED for share in shares):
        return None
    return max(shares) < 1.0


def assess(
    results: Mapping[str, Result],
    others: Mapping[str, Result],
    problem_set: ProblemSet | None = None,
) -> Submission:
    """Where the results of one policy, usually one file, would stand among the `others`.

    An entry of the same policy among the others steps aside.

    Args:
        problem_set: what the leaderboard is of; None for the one that comes with the package.

    Raises:
        ResultsError: a result is wrong (see `check`) or made on another problem set, or they are of
            several policies.
        LeaderboardError: results do not go together.
    """
    of = problem_set or load_set()
    for name, result in results.items():
        header = result.header
        if (header.problem_set, header.problem_set_sha256) != (of.name, of.sha256):
            raise ResultsError(
                f"{name}: made on {header.problem_set} ({header.problem_set_sha256[:12]}...); "
                f"the leaderboard is of {of.name} ({of.sha256[:12]}...)"
            )
        check(name, result, of)
    headers = [result.header for result in results.values()]
    policy = headers[0].policy
    if another := [header.policy for header in headers if header.policy != policy]:
        raise ResultsError(f"these are of two policies, {policy} and {another[0]}; submit one")
    for (one, result), (two, other) in combinations(results.items(), 2):
        if told := difference(result.header, other.header):
            raise ResultsError(
                f"{one} and {two}: expected one run, each file of other tasks, got {told}"
            )
    rivals = {
        name: other
        for name, other in others.items()
        if policy not in (other.header.policy, other.header.name)
    }
    sizes = of.counts
    # What the user calls the run is not what it is submitted as.
    unnamed = {
        name: result.model_copy(update={"header": result.header.model_copy(update={"name": ""})})
        for name, result in results.items()
    }
    board = build({**rivals, **unnamed}, sizes, headers[0].protocol)
    entry = next(entry for entry in board.entries if entry.policy == policy)
    columns = [*sizes, ALL]
    notes = _notes(headers, [other.header for other in rivals.values()])
    if len(rivals) < len(others):
        notes.append(f"the entry that {policy} has already is left out of the comparison")
    return Submission(
        entry=entry,
        standings=tuple(_standing(board, entry, column) for column in columns),
        missing=tuple(_missing(entry, headers, list(rivals.values()), sizes)),
        notes=tuple(notes),
    )


def _share(entry: Entry, column: str) -> float | None:
    """The success rate of a whole run; None for a partial one, or without a valid row."""
    cell = cell_of(entry, column)
    return None if cell is None or cell.partial or not cell.success.n else cell.success.share


def _standing(board: Leaderboard, entry: Entry, column: str) -> Standing:
    shares = {other.policy: _share(other, column) for other in board.entries}
    own = shares[entry.policy]
    ranked = {policy: share for policy, share in shares.items() if share is not None}
    if own is None:
        return Standing(column, None, len(ranked), None)
    above = {policy: share for policy, share in ranked.items() if share > own}
    ahead = min(above, key=lambda policy: (above[policy], policy)) if above else None
    return Standing(column, len(above) + 1, len(ranked), ahead)


def _missing(
    entry: Entry, headers: list[Header], rivals: list[Result], sizes: Mapping[str, int]
) -> list[str]:
    lines = []
    for task, count in sizes.items():
        cell = entry.cells.get(task)
        if cell is None:
            lines.append(f"{task}: all {count} problems")
        elif cell.partial:
            ran = cell.success.n + cell.left_out
            lines.append(f"{task}: {count - ran} of {count} problems")
    protocol = headers[0].protocol
    newest = max((rival.header.protocol for rival in rivals), default=protocol)
    if protocol < newest:
        lines.append(f"protocol {newest}: this is of protocol {protocol}, whose scores differ")
    rivals = [rival for rival in rivals if rival.header.protocol == protocol]
    seeds = {rival.header.seed for rival in rivals}
    if odd := sorted({header.seed for header in headers} - seeds) if seeds else []:
        wanted = ", ".join(map(str, sorted(seeds)))
        lines.append(f"seed {wanted}: this is seed {odd[0]}, so boxes and points are others")
    if others := [header.precision for header in headers if header.precision != "float32"]:
        lines.append(f"precision float32: this is {others[0]}")
    return lines


def _notes(headers: list[Header], rivals: list[Header]) -> list[str]:
    notes = []
    if headers[0].privileged:
        notes.append("privileged: it was given the obstacle models, and is marked so")
    theirs = {
        name: {rival.versions.get(name, "none") for rival in rivals} for name in headers[0].versions
    }
    differing = [
        f"{name} {version} ({', '.join(sorted(theirs[name]))})"
        for name, version in headers[0].versions.items()
        if theirs[name] and version not in theirs[name]
    ]
    if differing:
        notes.append(f"made with other versions than the entries there are: {'; '.join(differing)}")
    return notes
