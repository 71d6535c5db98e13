"""A leaderboard for other programs: one record for each policy and task."""

from __future__ import annotations

import csv
import io
import json
from typing import Any

from . import measures
from .board import Leaderboard


def records(board: Leaderboard) -> list[dict[str, Any]]:
    """Of each policy and task: rank, whether it is partial or privileged, how many rows were left
    out, and of each measure k, n, its share and the bounds of the 95 % interval."""
    found = []
    for entry in board.entries:
        for task in measures.columns(board.tasks):
            cell = measures.cell_of(entry, task)
            if cell is None:
                continue
            one: dict[str, Any] = {
                "policy": entry.policy,
                "rank": entry.rank,
                "task": task,
                "protocol": board.protocol,
                "problem_set": board.problem_set,
                "privileged": entry.privileged,
                "partial": cell.partial,
                "left_out": cell.left_out,
            }
            for name, _ in measures.MEASURES:
                rate = getattr(cell, name)
                low, high = rate.interval
                values = (rate.k, rate.n, rate.share if rate.n else None, low, high)
                kinds = ("k", "n", "share", "low", "high")
                one |= {f"{name}_{kind}": v for kind, v in zip(kinds, values, strict=True)}
            found.append(one)
    return found


def as_json(board: Leaderboard) -> str:
    """The records as a JSON list."""
    return json.dumps(records(board), indent=1) + "\n"


def as_csv(board: Leaderboard) -> str:
    """The records as CSV, with a head line."""
    lines, file = records(board), io.StringIO()
    writer = csv.DictWriter(file, list(lines[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(lines)
    return file.getvalue()
