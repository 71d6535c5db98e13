"""What the command line shows: progress, lists, cards."""

from collections.abc import Mapping, Sequence
from typing import Any, Self

from rich.console import Console, RenderableType
from rich.table import Table
from rich.text import Text

from drpbench.evaluation.progress import bars


def console_of() -> Console:
    """The terminal's. What it prints is text: a name in brackets is no markup."""
    return Console(markup=False, highlight=False)


class DataProgress:
    """A bar of problems drawn, and how many were solved; plain lines without a terminal.

    `words` are other names for drawn and solved.
    """

    def __init__(self, console: Console, count: int, words: tuple[str, str] = ("drawn", "solved")):
        self._console, self._drawn, self._solved = console, 0, 0
        self._words = words
        self._bars = bars(console)
        self._bar = self._bars.add_task("data", total=count, told="drawing")

    def __enter__(self) -> Self:
        self._bars.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._bars.stop()

    def advance(self, drawn: int, solved: int) -> None:
        self._drawn += drawn
        self._solved += solved
        drawn_word, solved_word = self._words
        told = f"{self._drawn} {drawn_word}, {self._solved} {solved_word}"
        self._bars.update(self._bar, advance=drawn, told=told)
        if not self._console.is_terminal and solved:
            self._console.print(told)


class TrainingProgress:
    """A live line of loss, rate and time left; plain lines without a terminal."""

    def __init__(self, console: Console, steps: int):
        self._console = console
        self._bars = bars(console)
        self._bar = self._bars.add_task("train", total=steps, told="compiling")

    def __enter__(self) -> Self:
        self._bars.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._bars.stop()

    def line(self, line: Any, run: Any) -> None:
        told = f"loss {line.loss:.4f}, {line.samples_per_second:.0f} samples/s"
        self._bars.update(self._bar, completed=line.step, told=told)
        left = (run.settings.steps - line.step) * run.settings.batch / line.samples_per_second
        text = f"step {line.step}: {told}, {left / 60:.0f} min left"
        if line.validated:
            text += (
                f"; validation: {line.succeeded}/{line.validated} succeeded, "
                f"{line.reached} reached, {line.collided} collided; "
                f"abroad: {line.abroad_succeeded}/{line.abroad_validated} succeeded"
            )
        if line.validated or not self._console.is_terminal:
            self._console.print(text)


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
