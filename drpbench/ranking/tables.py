"""A leaderboard, or one run, as tables for the terminal (rich).

No figure is ever cut: where a table is wider than the terminal, each policy gets a block of its
own, a line a task.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

from rich import box
from rich.console import Console, Group, RenderableType
from rich.measure import Measurement
from rich.table import Table
from rich.text import Text

from . import measures
from .board import Cell, Entry, Leaderboard
from .measures import ABSENT
from .reported import REPORTED, REPORTED_NOTE, REPORTED_TASKS, method, reported_rates

SHORT = ("success", "by_deadline", "collided", "reached")
"""The measures that are shown where none is asked for."""


def render_terminal(
    board: Leaderboard, console: Console, wanted: Sequence[str] = SHORT
) -> RenderableType:
    """The leaderboard for a console, the paper's figures beneath. `wanted` are of `MEASURES`."""
    titles = dict(measures.MEASURES)
    names = [name for name in wanted if measures.shown(name, board.entries)]
    tables = [_measure_table(board, name, titles[name]) for name in names]
    parts: list[RenderableType] = [Text(measures.heading(board), style="bold")]
    if all(_width(table) <= console.width for table in tables):
        parts += [_broad(table, console.width) for table in tables]
    else:
        for entry in board.entries:
            parts += _fitting(partial(_entry_table, entry), names, console.width)
    if len(board.entries) > 1:
        table = _paired_table(board)
        fits = _width(table) <= console.width
        parts += [_broad(table, console.width)] if fits else _paired_in_words(board)
    told = measures.notes(board.entries) + measures.others(board)
    parts += [Text(note, style="dim") for note in told]
    parts += _fitting(_reported_table, REPORTED_TASKS, console.width)
    parts.append(Text(REPORTED_NOTE, style="dim"))
    return Group(*parts)


def width_needed(board: Leaderboard, wanted: Sequence[str] = SHORT) -> int:
    """Columns that the widest table takes: what a pipe is given."""
    titles = dict(measures.MEASURES)
    tables = [_measure_table(board, name, titles[name]) for name in wanted]
    tables += [_paired_table(board), _reported_table(REPORTED_TASKS)]
    return max(map(_width, tables))


def render_entry(entry: Entry, console: Console) -> RenderableType:
    """One policy's figures for a console: a line per task, a column per measure."""
    told = [Text(note, style="dim") for note in measures.notes([entry])]
    return Group(*_fitting(partial(_entry_table, entry), SHORT, console.width), *told)


def _fitting(
    table: Callable[[Sequence[str]], Table], columns: Sequence[str], width: int
) -> list[Table]:
    """The table with these columns, in as many pieces, one below the other, as the width takes."""
    pieces: list[Sequence[str]] = []
    for column in columns:
        if pieces and _width(table([*pieces[-1], column])) <= width:
            pieces[-1] = [*pieces[-1], column]
        else:
            pieces.append([column])
    return [_broad(table(piece), width) for piece in pieces]


def _broad(table: Table, width: int) -> Table:
    """The table, so broad that its few columns don't squeeze its title."""
    table.min_width = min(max(map(len, str(table.title).splitlines())), width)
    return table


def _width(table: Table) -> int:
    """Columns that it takes where nothing is cut."""
    plain = Console(width=10_000)
    return Measurement.get(plain, plain.options, table).maximum


_HEADS = {
    "success": "Success",
    "reached": "Reached",
    "collided": "Collided",
    "by_deadline": "By deadline",
    "light": "Light",
    "clean": "Clean",
    "reached_5cm": "Reached 5 cm",
}


def _entry_table(entry: Entry, wanted: Sequence[str]) -> Table:
    names = [name for name in wanted if measures.shown(name, [entry])]
    place = f" (rank {entry.rank})" if entry.rank is not None else ""
    mark = "†" if entry.privileged else ""
    table = _table(f"\n{entry.policy}{mark}{place}: {measures.UNITS}", "Task")
    for name in names:
        table.add_column(_HEADS[name], justify="right", no_wrap=True)
    for task in measures.columns(entry.cells):
        cell = measures.cell_of(entry, task)
        table.add_row(task, *(_stacked(cell, name) for name in names))
    return table


def _table(title: str, first: str) -> Table:
    table = Table(
        title=title,
        title_justify="left",
        title_style="bold",
        box=box.SIMPLE_HEAD,
        padding=(0, 1, 0, 0),
        pad_edge=False,
        show_edge=False,
    )
    table.add_column(first, no_wrap=True, overflow="fold")
    return table


def _measure_table(board: Leaderboard, measure: str, title: str) -> Table:
    table = _table(f"\n{title} ({measures.UNITS})", "#")
    table.add_column("Policy", no_wrap=True)
    columns = measures.columns(board.tasks)
    for column in columns:
        table.add_column(column, justify="right", no_wrap=True)
    for entry in board.entries:
        cells = (measures.cell_of(entry, column) for column in columns)
        line = (_stacked(cell, measure) for cell in cells)
        table.add_row(measures.rank(entry), _policy(entry), *line)
    return table


def _policy(entry: Entry) -> Text:
    # A cell has two lines, so a composed policy's name may have them too.
    return Text(entry.policy.replace("+", "\n+") + ("†" if entry.privileged else ""), style="bold")


def _stacked(cell: Cell | None, measure: str) -> Text:
    if cell is None:
        return Text(ABSENT, style="dim")
    count, interval = measures.figures(getattr(cell, measure), cell.partial)
    return Text.assemble(count, "\n", (interval, "dim"))


def _paired_table(board: Leaderboard) -> Table:
    table = _table(f"\n{measures.PAIRED}", measures.PAIRED_HEAD[0])
    table.add_column(measures.PAIRED_HEAD[1], no_wrap=True)
    for heading in measures.PAIRED_HEAD[2:]:
        table.add_column(heading, justify="right", no_wrap=True)
    for one, other, *figures in measures.paired_lines(board):
        table.add_row(*(name.replace("+", "\n+") for name in (one, other)), *figures)
    return table


def _paired_in_words(board: Leaderboard) -> list[Text]:
    """The same for a narrow terminal, two lines a pair."""
    told = [Text(f"\n{measures.PAIRED}", style="bold")]
    for one, other, first, second, shared, difference, p in measures.paired_lines(board):
        told.append(Text(f"{one} against {other}: {first} alone, {second} alone, of {shared}"))
        told.append(Text(f"  {difference} points, p {p}", style="dim"))
    return told


def _reported_table(tasks: Sequence[str]) -> Table:
    table = _table(
        "\nThe paper's table: success %, below it reach/collision % († privileged)", "Method"
    )
    for task in tasks:
        table.add_column(task, justify="right", no_wrap=True)
    for reported in REPORTED:
        table.add_row(
            method(reported).replace(" (", "\n("),
            *(
                Text.assemble(f"{success:.2f}", "\n", (rate, "dim"))
                for task, success, rate in zip(
                    REPORTED_TASKS, reported.success, reported_rates(reported), strict=True
                )
                if task in tasks
            ),
        )
    return table
