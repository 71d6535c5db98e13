"""Are the rows of a result reproduced? A random part of them is run again, as it was run."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from drpbench.problems import ProblemSet
from drpbench.ranking.submission import check
from drpbench.results import Header, Result, ResultsError, Row
from drpbench.results.schema import Scalar

from .progress import RunProgress
from .rerun import rerun

VERDICT = ("success", "reached", "collided", "valid")
"""The fields of a row that the leaderboard counts."""


@dataclass(frozen=True)
class Difference:
    """One field of one row: what the file says, and what came of running it again."""

    task: str
    id: int
    field: str
    was: Scalar | None
    now: Scalar | None

    @property
    def amount(self) -> float | None:
        """By how much, where both are numbers."""
        was, now = self.was, self.now
        if isinstance(was, bool) or isinstance(now, bool):
            return None
        if isinstance(was, (int, float)) and isinstance(now, (int, float)):
            return abs(was - now)
        return None


@dataclass(frozen=True)
class Verification:
    """What running rows again showed.

    Attributes:
        rows: how many were run again.
        differences: every field that differs, by task and id.
        elsewhere: what the run then and the run now were not both made with: software, device.
    """

    rows: int
    differences: tuple[Difference, ...]
    elsewhere: tuple[str, ...]

    @property
    def equal(self) -> int:
        """Rows that are the same in every field, to the bit."""
        return self.rows - len({(d.task, d.id) for d in self.differences})

    @property
    def turned(self) -> tuple[Difference, ...]:
        """The differences in a verdict."""
        return tuple(d for d in self.differences if d.field in VERDICT)

    @property
    def reproduced(self) -> bool:
        """Whether every verdict is the same."""
        return not self.turned


def sample(result: Result, count: int, seed: int = 0) -> dict[str, list[int]]:
    """`count` rows at random (all, where there are no more) as ids by task, in the order of the
    file."""
    rng = np.random.default_rng(seed)
    chosen = rng.choice(len(result.rows), min(count, len(result.rows)), replace=False)
    ids: dict[str, list[int]] = {}
    for index in sorted(chosen):
        row = result.rows[index]
        ids.setdefault(row.task, []).append(row.id)
    return ids


def verify(
    name: str,
    result: Result,
    count: int,
    seed: int,
    progress: RunProgress,
    problem_set: ProblemSet | None = None,
) -> Verification:
    """Runs `count` random rows again, with the same policy, parameters, seed and batch size, and
    compares.

    Args:
        name: what a message should call the result, usually its file.
        count: how many rows, at least 1.
        seed: of which rows.
        problem_set: the one that the result was made on, where it does not come with the package.

    Raises:
        ResultsError: the result is wrong (see `submission.check`), holds no row, or its policy
            cannot be made with the parameters it states.
        PolicyError, WeightsError: its policy cannot be made.
    """
    check(name, result, problem_set)
    if not result.rows:
        raise ResultsError(f"{name}: holds no row to run again")
    header = result.header
    again = rerun(name, header, sample(result, count, seed), progress, problem_set=problem_set)
    rows = {row.key: row for row in result.rows}
    found = [d for row in again.rows for d in _differences(rows[row.key], row)]
    return Verification(len(again.rows), tuple(found), _elsewhere(header, again.header))


def _differences(was: Row, now: Row) -> list[Difference]:
    values = ((field, getattr(was, field), getattr(now, field)) for field in Row.model_fields)
    return [Difference(was.task, was.id, field, a, b) for field, a, b in values if a != b]


def _elsewhere(was: Header, now: Header) -> tuple[str, ...]:
    pairs = {key: (value, now.versions.get(key)) for key, value in was.versions.items()}
    pairs |= {"device": (was.device, now.device), "platform": (was.platform, now.platform)}
    pairs |= {"processor": (was.processor or "unknown", now.processor)}
    for name in sorted(was.environment.keys() | now.environment.keys()):
        pairs[name] = (was.environment.get(name, "unset"), now.environment.get(name, "unset"))
    return tuple(f"{key} {a} then, {b} now" for key, (a, b) in pairs.items() if a != b)
