"""What a training run leaves behind to look at: a CSV of its progress and a plot of it."""

from __future__ import annotations

import csv
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from drpbench.errors import DrpbenchError
from drpbench.ranking import wilson


@dataclass(frozen=True)
class Progress:
    """One line of the CSV. Loss and rate are those since the line before."""

    step: int
    samples: int
    seconds: float
    """Of training in all, over interruptions."""
    loss: float
    learning_rate: float
    samples_per_second: float
    validated: int = 0
    """Episodes of a validation at this step, and how many of them reached, collided, succeeded."""
    reached: int = 0
    collided: int = 0
    succeeded: int = 0
    abroad_validated: int = 0
    """The same, of scenes that nothing is learned from."""
    abroad_reached: int = 0
    abroad_collided: int = 0
    abroad_succeeded: int = 0


class History:
    """A CSV that grows by one line at a time and outlives a crash."""

    def __init__(self, path: Path):
        self._path = path

    def read(self) -> list[Progress]:
        """The lines so far, none if there is no file."""
        if not self._path.exists():
            return []
        with open(self._path, newline="", encoding="utf-8") as file:
            kinds = {f.name: int if f.type == "int" else float for f in fields(Progress)}
            rows: list[dict[str, Any]] = [
                {name: kinds[name](value) for name, value in row.items()}
                for row in csv.DictReader(file)
            ]
        return [Progress(**row) for row in rows]

    def rewind(self, step: int) -> list[Progress]:
        """Drops the lines beyond a step: a resumed run makes them again. Returns those that
        stay."""
        kept = [line for line in self.read() if line.step <= step]
        self._path.unlink(missing_ok=True)
        for line in kept:
            self.add(line)
        return kept

    def add(self, line: Progress) -> None:
        """Writes one line."""
        new = not self._path.exists()
        with open(self._path, "a", newline="", encoding="utf-8") as file:
            writer = csv.DictWriter(file, [f.name for f in fields(Progress)])
            if new:
                writer.writeheader()
            writer.writerow(asdict(line))


class TensorBoard:
    """The history as an event file for TensorBoard, in a folder of its own. A context manager."""

    def __init__(self, folder: Path):
        """Raises DrpbenchError where tensorboardX is not installed."""
        try:
            from tensorboardX import SummaryWriter
        except ImportError:
            raise DrpbenchError(
                "--tensorboard needs tensorboardX, which is not installed: "
                "pip install 'drpbench[train]'"
            ) from None
        self._folder, self._open = folder, SummaryWriter
        self._writer: Any = None

    def __enter__(self) -> TensorBoard:
        return self

    def __exit__(self, *_: object) -> None:
        if self._writer is not None:
            self._writer.close()

    def add(self, line: Progress) -> None:
        """Writes one line: rates of a validation only where there was one."""
        if self._writer is None:  # with the first line, so that a refused run leaves nothing
            self._writer = self._open(str(self._folder))
        values = {"loss": line.loss, "learning rate": line.learning_rate}
        values["samples per second"] = line.samples_per_second
        for place, count in (("", line.validated), ("abroad_", line.abroad_validated)):
            for name in ("reached", "collided", "succeeded") if count else ():
                values[f"validation/{place}{name}"] = getattr(line, place + name) / count
        for name, value in values.items():
            self._writer.add_scalar(name, value, line.step)


def plot(history: list[Progress], path: Path) -> None:
    """Loss, and validated success with its 95 % intervals, against samples, as a picture. Needs
    matplotlib."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.0, 5.0), layout="constrained")
    upper, lower = figure.subplots(2, sharex=True)
    upper.plot([p.samples for p in history], [p.loss for p in history], color="tab:blue")
    upper.set(ylabel="loss", ylim=(0, None))
    scored = [p for p in history if p.validated]
    samples = [p.samples for p in scored]
    for name, colour, of in (
        ("succeeded", "tab:green", "validated"),
        ("reached", "tab:gray", "validated"),
        ("collided", "tab:red", "validated"),
        ("abroad_succeeded", "tab:olive", "abroad_validated"),
    ):
        counts = [(getattr(p, name), getattr(p, of)) for p in scored]
        shares = np.array([100.0 * k / n for k, n in counts])
        low, high = 100.0 * np.array([wilson(k, n) for k, n in counts]).reshape(-1, 2).T
        lower.errorbar(
            samples,
            shares,
            [shares - low, high - shares],
            fmt="o-",
            color=colour,
            label=name.replace("_", ", "),
            capsize=2,
        )
    lower.set(xlabel="training samples", ylabel="% of validation", ylim=(0, 100))
    lower.legend()
    for axes in (upper, lower):
        axes.grid(alpha=0.3)
    figure.savefig(path, dpi=120)
