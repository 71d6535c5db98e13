"""The figures of a report: counts over the rows of results, small enough to be embedded in a page.

Rows that are not valid stand in no count, and a row that failed to run stays in every denominator.
"""

import shlex
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np

from drpbench.contract import EPISODE
from drpbench.ranking import Leaderboard, wilson
from drpbench.ranking.board import file_of
from drpbench.ranking.depth import successes_by_depth
from drpbench.results import Result, Row

from .recordings import Instance, Kept, gallery

TIMES = np.arange(0, EPISODE.steps + 1, 10) * EPISODE.period  # [s]
CLEARANCES = np.arange(-6, 21) / 100  # [m] edges of bins; the outermost bins are open
ERRORS = np.logspace(-4, 0, 81)  # [m]
DEPTHS = np.logspace(-5, -1, 81)  # [m] allowed depth of a contact

COLLIDED, LEFT, NOT_REACHED, FAILED = range(4)
REASONS = ("collided", "left the goal", "not reached", "failed to run")
"""Why an instance is no success, the first that holds: FAILED, COLLIDED, LEFT, NOT_REACHED."""

ABSENT = -1
"""In the columns of failures, whose values are integers: there is no such value."""


def figures(
    board: Leaderboard,
    results: Mapping[str, Result],
    folder: Path,
    recordings: Mapping[str, Kept],
    pictures: Mapping[Instance, str],
) -> dict:
    """Everything that the page draws, as plain values for JSON.

    Args:
        board: of these results; it gives the order of policies and tasks.
        results: by file name.
        folder: where the files lie, for the commands that replay an episode.
        recordings: what lies beside each file, by its name.
        pictures: of failures, as `data:` addresses.

    Returns:
        `policies` (name, privileged), `tasks`, `reasons`, the grids `times` [s], `clearances` [m]
            and `errors` [m], `cells` (see `cell`, with the indices `policy` and `task`), `failures`
            (see `failures`) and `gallery` (see there).
    """
    names = [entry.policy for entry in board.entries]
    cells = []
    rows: dict[tuple[str, str], list[Row]] = {}
    for result in results.values():
        for row in result.rows:
            if row.valid:
                rows.setdefault((result.header.policy, row.task), []).append(row)
    for policy, name in enumerate(names):
        for task, title in enumerate(board.tasks):
            if (name, title) in rows:
                cells.append({"policy": policy, "task": task, **cell(rows[name, title])})
    failed = failures(names, board.tasks, results, folder)
    files, columns = list(results), failed["columns"]
    instances = [
        (files[file], board.tasks[task], id)
        for file, task, id in zip(columns["replay"], columns["task"], columns["id"], strict=True)
    ]
    return {
        "policies": [{"name": e.policy, "privileged": e.privileged} for e in board.entries],
        "tasks": list(board.tasks),
        "reasons": REASONS,
        "times": [round(t, 4) for t in TIMES.tolist()],
        "clearances": CLEARANCES.tolist(),
        "errors": [float(f"{x:.5g}") for x in ERRORS.tolist()],
        "depths": [float(f"{x:.5g}") for x in DEPTHS.tolist()],
        "cells": cells,
        "failures": failed,
        "gallery": gallery(files, instances, recordings, pictures),
    }


def cell(rows: Sequence[Row]) -> dict:
    """The figures of one policy on one task.

    Returns:
        `n` rows; `success`: successes k, rows n and Wilson's 95 % interval of k/n; `families`: of
            each its name, and the same; `times`: successes that are at the goal to stay at each of
            TIMES; `clearances`: rows by smallest clearance, in one bin more than there are edges;
            `errors`: rows with a final position error below each of ERRORS; `depths`: successes if
            contacts as deep as each of DEPTHS were allowed.
    """
    families: dict[str, list[bool]] = {}
    for row in rows:
        families.setdefault(row.family, []).append(row.success)
    to_stay = np.sort([row.time_to_goal for row in rows if row.success])
    clearance = np.array([r.min_clearance for r in rows if r.min_clearance is not None], float)
    error = np.sort([row.position_error for row in rows if row.position_error is not None])
    bins = np.searchsorted(CLEARANCES, clearance, side="right")
    return {
        "n": len(rows),
        "success": _rate([row.success for row in rows]),
        "families": [[name, *_rate(won)] for name, won in sorted(families.items())],
        # A time in a row is rounded to six digits, by less than a hundredth of a control step.
        "times": np.searchsorted(to_stay, TIMES + 0.1 * EPISODE.period, side="right").tolist(),
        "clearances": np.bincount(bins, minlength=len(CLEARANCES) + 1).tolist(),
        "errors": np.searchsorted(error, ERRORS, side="left").tolist(),
        "depths": successes_by_depth(rows, DEPTHS).tolist(),
    }


def failures(
    policies: Sequence[str],
    tasks: Sequence[str],
    results: Mapping[str, Result],
    folder: Path,
) -> dict:
    """The instances that are no success, packed into columns of integers.

    Returns:
        The lists that columns point into: `replays` (of each file the command that replays an
            episode, up to its id), `families`, `links`, `statuses`; and `columns`, with the indices
            `policy`, `task`, `replay`, `family`, `reason`, `link` and `status`, the `id`, the
            control `step` of the first collision, and the final errors `position` [0.1 mm] and
            `orientation` [0.1 degrees]. ABSENT where there is none.
    """
    failed = [
        (file, result.header.policy, row)
        for file, result in enumerate(results.values())
        for row in result.rows
        if row.valid and not row.success
    ]
    families = _places(row.family for _, _, row in failed)
    links = _places(row.first_collision_link for _, _, row in failed)
    statuses = _places(None if row.status == "ok" else row.status for _, _, row in failed)
    rank = {policy: place for place, policy in enumerate(policies)}
    packed = sorted(
        (
            rank[policy],
            tasks.index(row.task),
            row.id,
            file,
            families[row.family],
            reason(row),
            ABSENT if row.first_collision_step is None else row.first_collision_step,
            links.get(row.first_collision_link or "", ABSENT),
            _scaled(row.position_error, 1e4),
            _scaled(row.orientation_error, 1800 / np.pi),
            statuses.get(row.status, ABSENT),
        )
        for file, policy, row in failed
    )
    fields = [
        *("policy", "task", "id", "replay", "family", "reason"),
        *("step", "link", "position", "orientation", "status"),
    ]
    columns = zip(*packed, strict=True) if packed else [()] * len(fields)
    return {
        "replays": [
            f"drpbench replay {shlex.quote(str(file_of(folder, name)))}" for name in results
        ],
        "families": list(families),
        "links": list(links),
        "statuses": list(statuses),
        "columns": dict(zip(fields, map(list, columns), strict=True)),
    }


def reason(row: Row) -> int:
    """Why a row is no success, an index into REASONS."""
    if row.status != "ok":
        return FAILED
    if row.collided:
        return COLLIDED
    return LEFT if row.reached_once else NOT_REACHED


def _rate(won: Sequence[bool]) -> list[float]:
    k, n = sum(won), len(won)
    return [k, n, *(round(bound, 6) for bound in wilson(k, n))]


def _places(values: Iterable[str | None]) -> dict[str, int]:
    """Each value's place in alphabetical order; none for None."""
    known = {value for value in values if value is not None}
    return {value: place for place, value in enumerate(sorted(known))}


def _scaled(value: float | None, scale: float) -> int:
    return ABSENT if value is None else round(value * scale)
