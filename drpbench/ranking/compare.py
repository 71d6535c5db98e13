"""Two runs on the same problems, problem by problem."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from drpbench.results import Result, Row
from drpbench.results.names import recordings_folder

from .board import LeaderboardError, require_same
from .measures import paired_figures
from .statistics import paired


def compared(results: Mapping[str, Result], most: int) -> list[str]:
    """Lines on two results: of each task how many problems both, one or none solved, with McNemar's
    test, and the first `most` problems whose verdict turned, with their recordings.

    Raises LeaderboardError where they are of two protocols or problem sets, or share no instance.
    """
    (first, a), (second, b) = results.items()
    require_same(results, ("protocol", "problem_set_sha256", "seed"))
    rows = [{row.key: row for row in result.rows if row.valid} for result in (a, b)]
    shared = [key for key in rows[0] if key in rows[1]]
    if not shared:
        raise LeaderboardError(f"{first} and {second}: expected a problem in common, got none")
    lines = [f"A: {first} ({a.header.called})", f"B: {second} ({b.header.called})"]
    tasks = list(dict.fromkeys(task for task, _ in shared))
    for task in tasks:
        keys = [key for key in shared if key[0] == task]
        test = paired((rows[0][key] for key in keys), (rows[1][key] for key in keys))
        both = sum(rows[0][key].success and rows[1][key].success for key in keys)
        *_, difference, p = paired_figures(test)
        lines.append(
            f"{task}: both {both}, A alone {test.only_first}, B alone {test.only_second}, neither "
            f"{test.shared - both - test.only_first - test.only_second}, of {test.shared}; A minus "
            f"B {difference} points, p {p}"
        )
    turned = [key for key in shared if rows[0][key].success != rows[1][key].success]
    for key in turned[:most]:
        one, two = rows[0][key], rows[1][key]
        lines.append(f"  {key[0]} {key[1]} ({one.family}): A {_outcome(one)}, B {_outcome(two)}")
        lines += [f"    {found}" for name in results for found in _recordings(name, key)]
    if len(turned) > most:
        lines.append(f"  and {len(turned) - most} more")
    return lines


def _outcome(row: Row) -> str:
    if row.success:
        return "solves it"
    if row.status != "ok":
        return f"fails to run ({row.status})"
    if row.collided:
        return f"touches with {row.first_collision_link} at step {row.first_collision_step}"
    return "does not reach it"


def _recordings(name: str, key: tuple[str, int]) -> list[Path]:
    folder = recordings_folder(Path(name))
    return sorted(folder.glob(f"{key[0]}-{key[1]:05d}.*")) if folder.is_dir() else []
