"""One run in parts that many machines make: which problems a part has, and the whole again."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping, Sequence

from drpbench.errors import InputError

from .schema import Header, Result, ResultsError, Row

_ARRAY = ("SLURM_ARRAY_TASK_ID", "SLURM_ARRAY_TASK_MIN", "SLURM_ARRAY_TASK_COUNT")
_OF_A_PART = frozenset({"shard", "problems", "created", "wall_seconds", "about"})
_OF_A_MACHINE = ("device", "processor", "platform")


def parse(text: str) -> tuple[int, int]:
    """`3/16` as (3, 16), parts being counted from 1; `slurm` as SLURM's array variables have it.

    Raises InputError.
    """
    if text == "slurm":
        values = [os.environ.get(name, "") for name in _ARRAY]
        for name, value in zip(_ARRAY, values, strict=True):
            if not value.isdecimal():
                raise InputError(f"--shard slurm: expected a number in {name}, got {value!r}")
        number, first, count = map(int, values)
        part, of = number - first + 1, count
    else:
        if not re.fullmatch(r"\d+/\d+", text):
            raise InputError(
                f"--shard {text}: expected a part of a number of parts (3/16), or slurm"
            )
        part, of = map(int, text.split("/"))
    if not 1 <= part <= of:
        raise InputError(f"--shard {text}: expected a part from 1 to {of}, got {part}")
    return part, of


def share(
    wanted: Mapping[str, Sequence[int] | None], counts: Mapping[str, int], part: int, of: int
) -> dict[str, list[int]]:
    """The problems of a part: every `of`-th of each task's, so that all parts are alike.

    Raises InputError where a task has fewer problems than there are parts.
    """
    found = {}
    for task, ids in wanted.items():
        all_ids = range(counts[task]) if ids is None else ids
        if len(all_ids) < of:
            raise InputError(
                f"--shard {part}/{of}: {task} has {len(all_ids)} problems for {of} parts"
            )
        found[task] = list(all_ids[part - 1 :: of])
    return found


def merged(results: Mapping[str, Result], counts: Mapping[str, int]) -> Result:
    """The run of which `results`, by the names that a message should give them, are the parts.

    Equal parts may be there twice. `counts` are the problems of each task in the set. All is as if
    one run had made it; where parts were made on several machines, the header names each.

    Raises ResultsError where a result is no part, parts are of different runs or missing, or two of
    the same part disagree.
    """
    parts: dict[int, tuple[str, Result]] = {}
    of = 0
    (first_name, first), *_ = results.items()
    for name, result in results.items():
        if not result.header.shard:
            raise ResultsError(f"{name}: expected a part of a run (run --shard 3/16), got a whole")
        part, count = map(int, result.header.shard.split("/"))
        if part > count:
            raise ResultsError(f"{name}: expected a part from 1 to {count}, got {part}/{count}")
        of = of or count
        if count != of:
            raise ResultsError(
                f"{first_name} and {name}: expected parts of one run, got parts of "
                f"{of} and of {count}"
            )
        _require_one_run(first_name, first.header, name, result.header)
        if part in parts:
            _require_equal(part, of, *parts[part], name, result)
        else:
            parts[part] = name, result
    if missing := [f"{part}/{of}" for part in range(1, of + 1) if part not in parts]:
        raise ResultsError(f"expected all {of} parts, got none of {', '.join(missing)}")
    ordered = [parts[part] for part in range(1, of + 1)]
    headers = [result.header for _, result in ordered]
    order = {task: place for place, task in enumerate(first.header.tasks)}
    machines = {
        field: " + ".join(dict.fromkeys(getattr(header, field) for header in headers))
        for field in _OF_A_MACHINE
    }
    whole = first.header.model_copy(
        update={
            "shard": "",
            "problems": {task: _interleaved(ordered, task, counts) for task in order},
            "created": min(header.created for header in headers),
            "wall_seconds": sum(header.wall_seconds for header in headers),
            **machines,
        }
    )
    rows = [row for _, result in ordered for row in result.rows]
    return Result(header=whole, rows=sorted(rows, key=lambda row: (order[row.task], row.id)))


def _require_one_run(first: str, one: Header, second: str, other: Header) -> None:
    for field in Header.model_fields:
        if field in _OF_A_PART or field in _OF_A_MACHINE:
            continue
        a, b = getattr(one, field), getattr(other, field)
        if a != b:
            told = f" {str(a)[:40]} and {str(b)[:40]}" if isinstance(a, (str, int)) else ""
            raise ResultsError(
                f"{first} and {second}: expected parts of one run, got two of "
                f"{field.replace('_', ' ')}{told}"
            )


def _require_equal(part: int, of: int, first: str, a: Result, second: str, b: Result) -> None:
    """Raises ResultsError where two results of the same part differ in a row."""
    rows: list[dict[tuple[str, int], Row]] = [
        {row.key: row for row in result.rows} for result in (a, b)
    ]
    for key in sorted(rows[0].keys() | rows[1].keys()):
        if rows[0].get(key) != rows[1].get(key):
            raise ResultsError(
                f"{first} and {second}: both are part {part}/{of}, and disagree on {key[0]} "
                f"{key[1]}: leave one out"
            )


def _interleaved(
    ordered: Sequence[tuple[str, Result]], task: str, counts: Mapping[str, int]
) -> list[int] | None:
    """The ids that the whole run was asked for; None where these are all of the task's."""
    lists = [result.header.problems[task] or [] for _, result in ordered]
    of, total = len(lists), sum(map(len, lists))
    for place, (ids, (name, _)) in enumerate(zip(lists, ordered, strict=True)):
        if len(ids) != len(range(place, total, of)):
            raise ResultsError(
                f"{name}: expected as many problems of {task} as its part of the run has"
            )
    found = [lists[i % of][i // of] for i in range(total)]
    if len(set(found)) < total:
        raise ResultsError(
            f"{ordered[0][0]}: expected parts of one run, got a problem of {task} twice"
        )
    return None if found == list(range(counts[task])) else found
