"""What a leaderboard shows of each policy, and in which words: for terminal, Markdown and page."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import pairwise
from typing import TYPE_CHECKING

from .statistics import Paired

if TYPE_CHECKING:
    from .board import Cell, Entry, Leaderboard, Rate

MEASURES = (
    ("success", "Success: reached, never collided"),
    ("reached", "Reached at the end: 1 cm, 15°"),
    ("collided", "Collided"),
    ("by_deadline", "Success by the deadline: at the goal while obstacles are still there"),
    ("light", "Success if contacts up to 1 N do not count"),
    ("clean", "Success without self-collision"),
    ("reached_5cm", "Reached at the end: 5 cm, 15°"),
)
"""A cell's rates in the order they are shown, each with its title."""

UNITS = "k/n, %, [95 % interval]"
PARTIAL = (
    "An asterisk marks a partial run, which has no rank: not all problems of the task, or more "
    "than a tenth of them left out; in All, of the whole set."
)
PRIVILEGED = "† privileged: given the obstacle models."
PAIRED = "Successes in pairs, on shared problems: difference in points, McNemar's exact test"
PAIRED_HEAD = (
    "Policy",
    "against",
    "only the first",
    "only the second",
    "shared",
    "difference",
    "p",
)
ABSENT = "–"
ALL = "All"


def heading(board: Leaderboard) -> str:
    """What the board is of."""
    return (
        f"Leaderboard on {board.problem_set} (sha256 {board.problem_set_sha256[:12]}), "
        f"protocol {board.protocol}"
    )


def columns(tasks: Iterable[str]) -> list[str]:
    """The tasks, and all of them together where there are several."""
    tasks = list(tasks)
    return [*tasks, ALL] if len(tasks) > 1 else tasks


def cell_of(entry: Entry, column: str) -> Cell | None:
    """An entry's cell in a column, if it was run there."""
    return entry.overall if column == ALL else entry.cells.get(column)


def shown(measure: str, entries: Iterable[Entry]) -> bool:
    """Whether any entry has instances that the measure is of."""
    return any(getattr(entry.overall, measure).n for entry in entries)


def rank(entry: Entry) -> str:
    """1, 2, …; a partial run has none."""
    return ABSENT if entry.rank is None else str(entry.rank)


def figures(rate: Rate, partial: bool) -> tuple[str, str]:
    """`k/n share` and the interval, in per cent."""
    if not rate.n:
        return ABSENT, ""
    low, high = rate.interval
    mark = "*" if partial else ""
    return f"{rate.k}/{rate.n} {percent(rate.share)}{mark}", f"[{percent(low)}, {percent(high)}]"


def percent(share: float) -> str:
    """None and all are told from nearly none and nearly all: 0 and 100 have no decimal."""
    return f"{100 * share:.1f}" if 0 < share < 1 else f"{100 * share:.0f}"


def paired_lines(board: Leaderboard) -> Iterable[list[str]]:
    """Each entry against the one below it; where shipped ones stand beside others, each of the
    others against every one."""
    own = [entry for entry in board.entries if entry.policy in board.own]
    if own and len(own) < len(board.entries):
        pairs = [(one, other) for one in own for other in board.entries if other is not one]
    else:
        pairs = list(pairwise(board.entries))
    for one, other in pairs:
        test = one.against(other)
        counts = paired_figures(test) if test.shared else [ABSENT] * 5
        yield [one.policy, other.policy, *counts]


def paired_figures(test: Paired) -> list[str]:
    """Counts, difference in points with its interval, p."""
    p = "< 0.0001" if test.p < 1e-4 else f"{test.p:.4f}"
    told, low, high = (f"{100 * value:+.1f}" for value in test.difference)
    difference = f"{told} [{low}, {high}]"
    return [str(test.only_first), str(test.only_second), str(test.shared), difference, p]


def notes(entries: Sequence[Entry]) -> list[str]:
    """What a reader must know beside the figures, a line each."""
    found = [f"{entry.policy}: {entry.about}." for entry in entries if entry.about]
    cells = [(entry, task, cell) for entry in entries for task, cell in entry.cells.items()]
    marked = any(cell.partial for _, _, cell in cells)
    # A run of one task alone has no column of all tasks, nor one of ranks.
    if marked or (len(entries) > 1 or len(cells) > 1) and any(e.rank is None for e in entries):
        found.append(PARTIAL)
    if any(entry.privileged for entry in entries):
        found.append(PRIVILEGED)
    left_out = [f"{e.policy} {task} {cell.left_out}" for e, task, cell in cells if cell.left_out]
    if left_out:
        found.append(
            "Left out of every n, for no box came (SAO: it had no room on the way; GB: on the "
            f"goal): {', '.join(left_out)}."
        )
    return found


def others(board: Leaderboard) -> list[str]:
    """Which results are of another version of the protocol, a line for each."""
    return [
        f"{count} {'result is' if count == 1 else 'results are'} of protocol {version} and "
        f"left out: --protocol {version} shows {'it' if count == 1 else 'them'}."
        for version, count in sorted(board.others.items())
    ]
