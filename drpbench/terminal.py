"""What the command line shows: progress, lists, cards."""

from collections.abc import Mapping, Sequence
from typing import Any

from rich.console import Console, RenderableType
from rich.progress import (
    BarColumn,
    Progress,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)
from rich.table import Table
from rich.text import Text


class RunProgress:
    """A bar for each task with running success and collision rates; plain lines without a terminal."""

    def __init__(self, console: Console, policy: str):
        self._console, self._policy = console, policy
        self._bars = Progress(
            TextColumn("{task.description:<4}"),
            BarColumn(bar_width=None),
            TextColumn("{task.percentage:>3.0f}%"),
            TextColumn("{task.fields[rates]}"),
            TimeElapsedColumn(),
            TimeRemainingColumn(),
            console=console,
            disable=not console.is_terminal,
        )

    def __enter__(self):
        self._bars.start()
        return self

    def __exit__(self, *_):
        self._bars.stop()

    def begin(self, task: str, steps: int, done: int) -> None:
        self._task, self._seen, self._won, self._hit = task, 0, 0, 0
        self._bar = self._bars.add_task(task, total=max(steps, 1), rates="compiling")
        if steps == 0:
            self._bars.update(self._bar, completed=1, rates="done before")
        if done:
            self._console.print(f"{task}: {done} rows were there already", highlight=False)

    def advance(self, steps: int) -> None:
        self._bars.advance(self._bar, steps)
        if self._seen == 0:
            self._bars.update(self._bar, rates="running")

    def rows(self, rows: Sequence[Any]) -> None:
        self._seen += len(rows)
        self._won += sum(row.success for row in rows)
        self._hit += sum(row.collided for row in rows)
        rates = (
            f"success {100 * self._won / self._seen:.0f}% "
            f"collided {100 * self._hit / self._seen:.0f}% of {self._seen}"
        )
        self._bars.update(self._bar, rates=rates)
        if not self._console.is_terminal:
            self._console.print(f"{self._policy} {self._task}: {rates}", highlight=False)


def listing(sections: Mapping[str, Sequence[tuple[str, str]]]) -> RenderableType:
    """Names and what they are, by section."""
    table = Table(box=None, show_header=False, pad_edge=False)
    table.add_column(style="bold", no_wrap=True)
    table.add_column()
    for title, entries in sections.items():
        table.add_row(Text(title, style="bold underline"), "")
        for name, about in entries:
            table.add_row("  " + name, about)
    return table


def problem_card(problem: Mapping[str, Any]) -> RenderableType:
    """One exported problem, for reading."""
    table = Table(box=None, show_header=False, pad_edge=False)
    table.add_column(style="bold", no_wrap=True)
    table.add_column()
    table.add_row("problem", f"{problem['task']} {problem['id']}")
    for key in ("family", "pair", "level"):
        if key in problem:
            table.add_row(key, str(problem[key]))
    for key in ("start", "goal"):
        table.add_row(f"{key} [rad]", " ".join(f"{q:7.3f}" for q in problem[key]))
    table.add_row("witness", f"{len(problem['witness'])} waypoints")
    for number, obstacle in enumerate(problem["obstacles"]):
        if obstacle["shape"] == "box":
            size = " x ".join(f"{s:.3f}" for s in obstacle["size"])
        elif obstacle["shape"] == "cylinder":
            size = f"radius {obstacle['radius']:.3f} height {obstacle['height']:.3f}"
        else:
            size = f"radius {obstacle['radius']:.3f}"
        place = " ".join(f"{p:6.3f}" for p in obstacle["position"])
        turn = " ".join(f"{w:6.3f}" for w in obstacle["quaternion"])
        title = f"obstacles [{len(problem['obstacles'])}]" if number == 0 else ""
        table.add_row(title, f"{obstacle['shape']:<8} {size:<28} at {place}  turned {turn}")
    return table


def diagnosis(report: Any) -> RenderableType:
    """What `drpbench doctor` found."""
    table = Table(box=None, show_header=False, pad_edge=False)
    table.add_column(style="bold", no_wrap=True)
    table.add_column()
    for name, value in report.facts.items():
        table.add_row(name, value)
    for name, passed, detail in report.checks:
        table.add_row(
            name, Text(("ok  " if passed else "FAILED  ") + detail, "green" if passed else "red")
        )
    return table
