"""A whole training run: feed, steps, checkpoints, validation, history, weights.

In the folder of a run lie `settings.json`, `checkpoints/`, `history.csv`, `history.png`, and
`weights.safetensors`: the newest average of the weights, with its card.
"""

from __future__ import annotations

import contextlib
import json
import math
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from drpbench.errors import DrpbenchError
from drpbench.evaluation.machine import device_name
from drpbench.generation.training_problems import ABROAD
from drpbench.policies.networks.impact_format import ImpactFormat
from drpbench.policies.weights import checksum, load_parameters, save

from .checkpoints import Checkpoints
from .cloning import Cloning, CloningSettings, TrainingState
from .feed import Feed
from .history import History, Progress, plot
from .learner import Learner, check
from .validation import Validation

_MAY_CHANGE = ("steps", "learning_rate")  # when a run is resumed: it goes on along the new schedule

# A run that was begun when IMPACT was the only network does not state it.
_BEFORE_NETWORKS = {"network": ImpactFormat.format()}


class TrainingError(DrpbenchError):
    """A run that cannot begin or go on as asked; the message says what would be right."""


@dataclass(frozen=True)
class Run:
    """What to train, and where. Periods are in steps; `report_every` divides all of them: so many
    steps are one call of the compiled program."""

    out: Path
    learner: Learner
    settings: CloningSettings = field(default_factory=CloningSettings)
    resume: bool = False
    report_every: int = 100
    checkpoint_every: int = 2000
    validate_every: int = 0
    """0: only at the end."""
    validation_problems: int = 64
    """At home, and as many abroad. 0: never validated."""
    begun_from: str = ""
    """Shipped weights by name, or a file of weights, that the run begins from; empty: a new
    network."""

    def __post_init__(self) -> None:
        for name, period in (
            ("steps", self.settings.steps),
            ("checkpoint-every", self.checkpoint_every),
            ("validate-every", self.validate_every),
        ):
            if period % self.report_every:
                raise TrainingError(
                    f"--{name} {period}: must be a multiple of --report-every {self.report_every}"
                )

    def facts(self) -> dict[str, Any]:
        """All that decides what is learned, as JSON has it; the size by its name if it has one."""
        names = [name for name, one in self.learner.sizes().items() if one == self.learner]
        decided = {
            "network": self.learner.format(),
            "size": names[0] if names else self.learner.settings(),
            **asdict(self.settings),
        }
        if self.begun_from:
            decided["begun_from"] = checksum(self.begun_from)
        return json.loads(json.dumps(decided))


def reported_every(*periods: int) -> int:
    """The largest number of steps up to 100 that divides all periods; 0 counts for none."""
    common = math.gcd(*periods)
    return max(n for n in range(1, min(common, 100) + 1) if common % n == 0)


def train(run: Run, feed: Feed, report: Callable[[Progress, Run], None]) -> Progress:
    """Trains to the last step and leaves everything in the run's folder; returns the last line.

    `report` gets every line of the history. Raises TrainingError, LearnerError, PolicyError,
    CheckpointError, DataError.
    """
    training = Cloning(run.learner, run.settings)
    _check_folder(run)
    history = History(run.out / "history.csv")
    checkpoints = Checkpoints(run.out / "checkpoints")
    if run.resume and (checkpoints.latest or 0) >= run.settings.steps:
        raise TrainingError(
            f"{run.out}: all {run.settings.steps} steps were done before; more with --steps"
        )
    first = feed.begin()
    check(run.learner, first, run.settings.batch, run.settings.precision)
    state = training.begin(_parameters(run))
    if run.resume:
        state = checkpoints.load(state)
    _note_settings(run, int(state.step))
    lines = history.rewind(int(state.step))
    spent = lines[-1].seconds if lines else 0.0
    demonstrations = training.resident(first)
    home: Validation | None = None
    abroad: Validation | None = None
    began = time.perf_counter()
    losses: list[np.ndarray] = []
    while (step := int(state.step)) < run.settings.steps:
        upto = step + run.report_every
        lap = time.perf_counter()
        state, loss = training.advance(state, demonstrations, steps=run.report_every)
        losses.append(np.asarray(loss))
        seconds = time.perf_counter() - lap
        if not np.isfinite(losses[-1]).all():
            raise TrainingError(
                f"the loss is no number at step {step + int(np.argmin(np.isfinite(losses[-1])))}: "
                "resume from the last checkpoint with a smaller --learning-rate"
            )
        last = upto == run.settings.steps
        scores: dict[str, int] = {}
        due = last or (run.validate_every and upto % run.validate_every == 0)
        if due and run.validation_problems:
            count, robot = run.validation_problems, run.learner.robot
            home = home or Validation(count, robot)
            abroad = abroad or Validation(count, robot, ABROAD)
            policy = run.learner.policy(state.average)
            scores = asdict(home.score(policy)) | {
                f"abroad_{name}": value for name, value in asdict(abroad.score(policy)).items()
            }
        line = Progress(
            step=upto,
            samples=upto * run.settings.batch,
            seconds=spent + time.perf_counter() - began,
            loss=float(np.mean(losses[-1])),
            learning_rate=float(training.schedule(upto)),
            samples_per_second=run.report_every * run.settings.batch / seconds,
            **scores,
        )
        history.add(line)
        report(line, run)
        if last or upto % run.checkpoint_every == 0:
            checkpoints.save(state)
            ship(run, state, history.read(), feed)
        demonstrations = feed.refresh(demonstrations)
    checkpoints.close()
    lines = history.read()
    with contextlib.suppress(ImportError):  # the picture needs matplotlib; the CSV has all of it
        plot(lines, run.out / "history.png")
    return lines[-1]


def _parameters(run: Run) -> Any:
    """Those that the run begins from, None for a new network's. Raises TrainingError where they
    are another network's."""
    if not run.begun_from:
        return None
    kind = {run.learner.title(): type(run.learner)}
    network, parameters, _ = load_parameters(run.begun_from, kind, run.learner.robot)
    if network.settings() != run.learner.settings():
        raise TrainingError(
            f"--from {run.begun_from}: its network has other sizes than the one to train"
        )
    return parameters


def ship(run: Run, state: TrainingState, lines: list[Progress], feed: Feed) -> None:
    """Writes the weights, with a card that says how they were made."""
    last = lines[-1]
    scored = [line for line in lines if line.validated]
    card = {
        "data": feed.about,
        "steps": f"{last.step} of {run.settings.steps}, {last.samples} samples",
        "hardware": f"{device_name()}, {last.seconds / 3600.0:.2f} h",
        "scores": "; ".join(
            f"step {line.step}: {line.succeeded}/{line.validated} validation problems solved at "
            f"home, {line.abroad_succeeded}/{line.abroad_validated} abroad"
            for line in scored[-1:]
        )
        or "not validated",
        "licence": "Apache-2.0",
        "loss": round(last.loss, 5),
        "schedule": _schedule(run),
        "training": run.facts(),
    }
    save(run.out / "weights.safetensors", run.learner, state.average, card)


def _check_folder(run: Run) -> None:
    """Raises TrainingError unless the folder is free for a new run, or holds the run to resume."""
    path = run.out / "settings.json"
    if not run.resume:
        if path.exists():
            raise TrainingError(
                f"{run.out} holds a run: go on with --resume, or name another --out"
            )
        return
    if not path.exists():
        raise TrainingError(f"{run.out} holds no run to resume: leave out --resume")
    before = _BEFORE_NETWORKS | json.loads(path.read_text())[-1]
    for name, value in run.facts().items():
        if name not in _MAY_CHANGE and before.get(name) != value:
            raise TrainingError(
                f"{run.out} was begun with {name} {before.get(name)}, not {value}: resume with that"
            )


def _note_settings(run: Run, step: int) -> None:
    """Writes with which settings the run goes on from this step, if they differ from those
    before."""
    path = run.out / "settings.json"
    stretches = json.loads(path.read_text()) if run.resume else []
    before = _BEFORE_NETWORKS | stretches[-1] if stretches else {}
    if any(before.get(name) != value for name, value in run.facts().items()):
        stretches.append({"from_step": step, **run.facts()})
        path.write_text(json.dumps(stretches, indent=1) + "\n")


def _schedule(run: Run) -> str:
    """In words, how long and at what rate was trained."""
    stretches = json.loads((run.out / "settings.json").read_text())
    return "; then ".join(
        f"from step {row['from_step']} towards {row['steps']} at {row['learning_rate']:g}"
        for row in stretches
    )
