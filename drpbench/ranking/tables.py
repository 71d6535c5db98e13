"""A leaderboard, or one run, as tables: for the terminal (rich) and as Markdown."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from rich import box
from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from .board import Cell, Entry, Leaderboard, Rate
from .reported import REPORTED, REPORTED_NOTE, REPORTED_TASKS, Reported
from .statistics import Paired

MEASURES = (
    ("success", "Success: reached, never collided"),
    ("reached", "Reached at the end: 1 cm, 15°"),
    ("collided", "Collided"),
    ("reached_5cm", "Reached at the end: 5 cm, 15°"),
)
"""A cell's rates in the order they are shown, each with its title."""

UNITS = "k/n, %, [95 % interval]"
PARTIAL = "An asterisk marks a partial run: not all problems of the task; in All, of the whole set."
PRIVILEGED = "† privileged: given the obstacle models."
PAIRED = "Successes against the next policy: on shared problems, McNemar's exact test"
ABSENT = "–"
ALL = "All"


def render_terminal(board: Leaderboard) -> RenderableType:
    """The leaderboard for a terminal of 100 columns or more, the paper's figures beneath."""
    parts: list[RenderableType] = [
        Text(_heading(board), style="bold"),
        *(_measure_table(board, measure, title) for measure, title in MEASURES),
    ]
    if any(entry.against_next for entry in board.entries):
        parts.append(_paired_table(board))
    parts += [Text(note, style="dim") for note in _notes(board.entries, _columns(board.tasks))]
    parts += [_reported_table(), Text(REPORTED_NOTE, style="dim")]
    return Group(*parts)


def render_entry(entry: Entry) -> RenderableType:
    """One policy's figures for a terminal: a line per task, a column per measure."""
    table = _table(f"{entry.policy}: {UNITS}", "Task")
    for heading in ("Success", "Reached 1 cm", "Collided", "Reached 5 cm"):
        table.add_column(heading, justify="right", overflow="fold")
    columns = _columns(entry.cells)
    for task in columns:
        cell = _cell(entry, task)
        table.add_row(task, *(_stacked(cell, measure) for measure, _ in MEASURES))
    return Group(table, *(Text(note, style="dim") for note in _notes([entry], columns)))


def render_markdown(board: Leaderboard) -> str:
    """The leaderboard as Markdown, the paper's figures beneath."""
    columns = _columns(board.tasks)
    blocks = [f"**{_heading(board)}**"]
    for measure, title in MEASURES:
        body = [
            [
                entry.policy + ("†" if entry.privileged else ""),
                *(_flat(_cell(entry, column), measure) for column in columns),
            ]
            for entry in board.entries
        ]
        blocks += [f"{title} ({UNITS})", _markdown(["Policy", *columns], body)]
    if any(entry.against_next for entry in board.entries):
        blocks += [PAIRED, _markdown(_PAIRED_HEAD, _paired_lines(board))]
    blocks += _notes(board.entries, columns)
    body = [
        [_method(reported)]
        + [
            f"{success:.2f}" + (f" ({rates})" if rates != ABSENT else "")
            for success, rates in zip(reported.success, _reported_rates(reported), strict=True)
        ]
        for reported in REPORTED
    ]
    blocks += [
        f"The paper's table, success % (reach/collision %). {REPORTED_NOTE}",
        _markdown(["Method", *REPORTED_TASKS], body),
    ]
    return "\n\n".join(blocks) + "\n"


def _heading(board: Leaderboard) -> str:
    return f"Leaderboard on {board.problem_set} (sha256 {board.problem_set_sha256[:12]})"


def _columns(tasks: Iterable[str]) -> list[str]:
    tasks = list(tasks)
    return [*tasks, ALL] if len(tasks) > 1 else tasks


def _cell(entry: Entry, column: str) -> Cell | None:
    return entry.overall if column == ALL else entry.cells.get(column)


def _table(title: str, first: str, width: int | None = None) -> Table:
    table = Table(
        title=title,
        title_justify="left",
        title_style="bold",
        min_width=min(len(title.strip()), 78),  # few columns must not squeeze the title
        box=box.SIMPLE_HEAD,
        padding=(0, 1, 0, 0),
        pad_edge=False,
        show_edge=False,
    )
    table.add_column(first, overflow="fold", min_width=width)
    return table


def _measure_table(board: Leaderboard, measure: str, title: str) -> Table:
    names = [_policy(entry) for entry in board.entries]
    # Where the terminal is too narrow, figures wrap between two numbers before a name breaks.
    longest = max(len(line) for name in names for line in name.plain.splitlines())
    table = _table(f"\n{title} ({UNITS})", "Policy", width=min(longest, 14))
    columns = _columns(board.tasks)
    for column in columns:
        table.add_column(column, justify="right", overflow="fold")
    for name, entry in zip(names, board.entries, strict=True):
        cells = (_cell(entry, column) for column in columns)
        table.add_row(name, *(_stacked(cell, measure) for cell in cells))
    return table


def _policy(entry: Entry) -> Text:
    # A cell has two lines, so a composed policy's name may have them too.
    return Text(entry.policy.replace("+", "\n+") + ("†" if entry.privileged else ""), style="bold")


def _stacked(cell: Cell | None, measure: str) -> Text:
    if cell is None:
        return Text(ABSENT, style="dim")
    count, interval = _figures(getattr(cell, measure), cell.partial)
    return Text.assemble(count, "\n", (interval, "dim"))


def _flat(cell: Cell | None, measure: str) -> str:
    return ABSENT if cell is None else " ".join(_figures(getattr(cell, measure), cell.partial))


def _figures(rate: Rate, partial: bool) -> tuple[str, str]:
    low, high = rate.interval
    share = _percent(rate.share) if rate.n else ABSENT
    mark = "*" if partial else ""
    return f"{rate.k}/{rate.n} {share}{mark}", f"[{_percent(low)}, {_percent(high)}]"


def _percent(share: float) -> str:
    # None and all are told from nearly none and nearly all: 0 and 100 have no decimal.
    return f"{100 * share:.1f}" if 0 < share < 1 else f"{100 * share:.0f}"


_PAIRED_HEAD = ("Policy", "against", "only the first", "only the second", "shared", "p")


def _paired_lines(board: Leaderboard) -> Iterable[list[str]]:
    for entry, below in zip(board.entries, board.entries[1:], strict=False):
        test = entry.against_next
        counts = [ABSENT] * 4 if test is None else _paired_figures(test)
        yield [entry.policy, below.policy, *counts]


def _paired_figures(test: Paired) -> list[str]:
    p = "< 0.0001" if test.p < 1e-4 else f"{test.p:.4f}"
    return [str(test.only_first), str(test.only_second), str(test.shared), p]


def _paired_table(board: Leaderboard) -> Table:
    table = _table(f"\n{PAIRED}", _PAIRED_HEAD[0])
    table.add_column(_PAIRED_HEAD[1], overflow="fold")
    for heading in _PAIRED_HEAD[2:]:
        table.add_column(heading, justify="right", overflow="fold")
    for line in _paired_lines(board):
        table.add_row(*line)
    return table


def _notes(entries: Sequence[Entry], columns: Sequence[str]) -> list[str]:
    notes = []
    cells = [(entry, task, cell) for entry in entries for task, cell in entry.cells.items()]
    shown = [_cell(entry, column) for entry in entries for column in columns]
    if any(cell.partial for cell in shown if cell):
        notes.append(PARTIAL)
    if any(entry.privileged for entry in entries):
        notes.append(PRIVILEGED)
    left_out = [f"{e.policy} {task} {cell.left_out}" for e, task, cell in cells if cell.left_out]
    if left_out:
        notes.append(f"Left out of every n, for the goal was never blocked: {', '.join(left_out)}.")
    return notes


def _method(reported: Reported) -> str:
    return reported.method + ("†" if reported.privileged else "")


def _reported_rates(reported: Reported) -> list[str]:
    return [
        ABSENT if reach is None or collision is None else f"{reach:.2f}/{collision:.2f}"
        for reach, collision in zip(reported.reach, reported.collision, strict=True)
    ]


def _reported_table() -> Table:
    table = _table(
        "\nThe paper's table: success %, below it reach/collision % († privileged)", "Method"
    )
    for task in REPORTED_TASKS:
        table.add_column(task, justify="right", overflow="fold")
    for reported in REPORTED:
        rates = _reported_rates(reported)
        table.add_row(
            _method(reported).replace(" (", "\n("),
            *(
                Text.assemble(f"{success:.2f}", "\n", (rate, "dim"))
                for success, rate in zip(reported.success, rates, strict=True)
            ),
        )
    return table


def _markdown(head: Sequence[str], body: Iterable[Sequence[str]]) -> str:
    lines = [head, ["---", *["---:"] * (len(head) - 1)], *body]
    escaped = ([cell.replace("|", "\\|") for cell in line] for line in lines)
    return "\n".join(f"| {' | '.join(line)} |" for line in escaped)
