"""A leaderboard as Markdown."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

from . import measures
from .reported import REPORTED, REPORTED_NOTE, REPORTED_TASKS, method, reported_rates

if TYPE_CHECKING:
    from .board import Entry, Leaderboard


def render_markdown(board: Leaderboard) -> str:
    """Every measure, the paired tests, the notes, and the paper's figures beneath."""
    blocks = [f"**{measures.heading(board)}**"]
    for measure, title in measures.MEASURES:
        if measures.shown(measure, board.entries):
            blocks += [f"{title} ({measures.UNITS})", _measure(board, measure)]
    body = list(measures.paired_lines(board))
    if body:
        blocks += [measures.PAIRED, _table(measures.PAIRED_HEAD, body)]
    blocks += measures.notes(board.entries) + measures.others(board)
    rows = [
        [method(reported)]
        + [
            f"{success:.2f}" + (f" ({rates})" if rates != measures.ABSENT else "")
            for success, rates in zip(reported.success, reported_rates(reported), strict=True)
        ]
        for reported in REPORTED
    ]
    blocks += [
        f"The paper's table, success % (reach/collision %). {REPORTED_NOTE}",
        _table(["Method", *REPORTED_TASKS], rows),
    ]
    return "\n\n".join(blocks) + "\n"


def _measure(board: Leaderboard, measure: str) -> str:
    columns = measures.columns(board.tasks)
    body = [
        [measures.rank(entry), entry.policy + ("†" if entry.privileged else "")]
        + [_figures(entry, column, measure) for column in columns]
        for entry in board.entries
    ]
    return _table(["#", "Policy", *columns], body)


def _figures(entry: Entry, column: str, measure: str) -> str:
    cell = measures.cell_of(entry, column)
    if cell is None:
        return measures.ABSENT
    return " ".join(measures.figures(getattr(cell, measure), cell.partial)).strip()


def _table(head: Sequence[str], body: Iterable[Sequence[str]]) -> str:
    numbers = head[2:] if head[0] == "#" else head[1:]
    rule = ["---"] * (len(head) - len(numbers)) + ["---:"] * len(numbers)
    escaped = ([cell.replace("|", "\\|") for cell in line] for line in (head, rule, *body))
    return "\n".join(f"| {' | '.join(line)} |" for line in escaped)
