"""What a run shows while it goes on."""

from collections.abc import Sequence
from typing import Any, Protocol, Self

from rich.console import Console
from rich.progress import (
    BarColumn,
    Progress,
    TaskID,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)

from drpbench.results import Row


class RunProgress(Protocol):
    """What is told of a run while it goes on."""

    def begin(self, task: str, steps: int, done: int) -> None:
        """A task begins: control steps of all its batches, and how many rows there were before."""

    def advance(self, steps: int) -> None:
        """So many more were simulated."""

    def rows(self, rows: Sequence[Row]) -> None:
        """Rows are finished, and safe."""


class Silent:
    """Shows nothing."""

    def begin(self, task: str, steps: int, done: int) -> None:
        pass

    def advance(self, steps: int) -> None:
        pass

    def rows(self, rows: Sequence[Row]) -> None:
        pass


class Bars:
    """A bar for each task with running success and collision rates; plain lines without a
    terminal."""

    def __init__(self, console: Console, policy: str):
        self._console, self._policy = console, policy
        self._bars = bars(console)
        self._bar = self._files = TaskID(0)
        self._task, self._seen, self._succeeded, self._collided = "", 0, 0, 0

    def __enter__(self) -> Self:
        self._bars.start()
        return self

    def __exit__(self, *_: Any) -> None:
        self._bars.stop()

    def begin(self, task: str, steps: int, done: int) -> None:
        self._task, self._seen, self._succeeded, self._collided = task, 0, 0, 0
        self._bar = self._bars.add_task(task, total=max(steps, 1), told="compiling")
        if steps == 0:
            self._bars.update(self._bar, completed=1, told="done before")
        if done:
            self._console.print(f"{task}: {done} rows were there already")

    def advance(self, steps: int) -> None:
        self._bars.advance(self._bar, steps)
        if self._seen == 0:
            self._bars.update(self._bar, told="running")

    def files(self, count: int) -> None:
        """Recordings that will be written: a bar of their own, which goes on after the rows."""
        self._files = self._bars.add_task("files", total=count, told="recordings")

    def wrote(self) -> None:
        """One of them was written."""
        self._bars.advance(self._files)

    def rows(self, rows: Sequence[Row]) -> None:
        self._seen += len(rows)
        self._succeeded += sum(row.success for row in rows)
        self._collided += sum(row.collided for row in rows)
        rates = (
            f"success {100 * self._succeeded / self._seen:.0f}% "
            f"collided {100 * self._collided / self._seen:.0f}% of {self._seen}"
        )
        self._bars.update(self._bar, told=rates)
        if not self._console.is_terminal:
            self._console.print(f"{self._policy} {self._task}: {rates}")


def bars(console: Console) -> Progress:
    """Bars with a name, a share, what is told of them, and times; nothing without a terminal."""
    return Progress(
        TextColumn("{task.description:<5}", markup=False),
        BarColumn(bar_width=None),
        TextColumn("{task.percentage:>3.0f}%"),
        TextColumn("{task.fields[told]}", markup=False),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
        console=console,
        disable=not console.is_terminal,
    )
