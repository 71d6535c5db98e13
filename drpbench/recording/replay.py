"""Episodes of a result file once more: as recorded where they were, else run again."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from drpbench.evaluation.machine import device_name, versions
from drpbench.evaluation.rerun import rerun
from drpbench.evaluation.run import world_of
from drpbench.problems import ProblemSet
from drpbench.ranking.submission import check, set_of
from drpbench.results import Header, Result, Row
from drpbench.results.names import trajectories_file
from drpbench.results.trajectories import load_trajectories
from drpbench.rollout import LANES, Trace

from .episode import Recording, RecordingError, episode, traced
from .motion import Motion, motion

# Rounding of what is recomputed is far below.
_SAME_POSITION, _SAME_ORIENTATION = 1e-3, 5e-3  # [m], [rad]


@dataclass(frozen=True)
class Replay:
    """An episode of a result, and what is to be said about it: nothing, where it is what the row
    says."""

    row: Row
    episode: Recording
    remark: str | None


class Replayer:
    """Episodes of the result in the file `path`.

    Beside it a file of trajectories is looked for, as `drpbench run --save-trajectories` writes it.
    What is not in there is run again with the same policy, parameters, seed and batch size.
    `advanced` is told of control steps done; `problem_set` is what the result was made on, where
    that does not come with the package. Raises ResultsError where the result is wrong (see
    `submission.check`), or was made on other problems.
    """

    def __init__(
        self,
        result: Result,
        path: Path,
        advanced: Callable[[int], None] = lambda steps: None,
        problem_set: ProblemSet | None = None,
    ):
        self.result, self.path, self.advanced = result, path, advanced
        self.recorded = trajectories_file(path)
        check(str(path), result, problem_set)
        self.problem_set = set_of(str(path), result.header, problem_set)

    @cached_property
    def _trajectories(self) -> Mapping[str, Mapping[str, np.ndarray]]:
        if not self.recorded.is_file():
            return {}
        try:
            return load_trajectories(self.recorded)
        except ValueError as error:
            raise RecordingError(str(error)) from None

    def rows(self, task: str | None) -> list[Row]:
        """Those of one task, by id; the task may be left out where the result has one only."""
        tasks = self.result.header.tasks
        if task is None and len(tasks) > 1:
            raise RecordingError(f"the result has {', '.join(tasks)}; say which with --task")
        task = task or tasks[0]
        found = [row for row in self.result.rows if row.task == task]
        if not found:
            raise RecordingError(f"the result has no {task}; it has: {', '.join(tasks)}")
        return found

    def row(self, task: str | None, id: int) -> Row:
        """That of one instance."""
        rows = self.rows(task)
        for row in rows:
            if row.id == id:
                return row
        ids = _listed([row.id for row in rows])
        raise RecordingError(f"the result has no {rows[0].task} {id}; it has {ids}")

    def spread(self, task: str | None, count: int) -> list[Row]:
        """So many of a task, spread evenly over its ids."""
        rows = self.rows(task)
        if not 0 < count <= len(rows):
            raise RecordingError(f"--grid {count}: the result has 1 to {len(rows)} to choose from")
        return [rows[i * len(rows) // count] for i in range(count)]

    def replay(self, rows: Sequence[Row]) -> list[Replay]:
        """The episodes of rows of one task, in their order."""
        missing = [row for row in rows if _key(row) not in self._trajectories]
        again = self._run_again(missing) if missing else {}
        return [again[row.id] if row.id in again else self._as_recorded(row) for row in rows]

    def _as_recorded(self, row: Row) -> Replay:
        arrays = self._trajectories[_key(row)]
        try:
            world, problems = world_of(self.problem_set, row.task), self.problem_set.task(row.task)
            found = episode(world, row.id, problems, self.result.header.seed, arrays)
        except RecordingError as error:
            raise RecordingError(f"{self.recorded}: {error}") from None
        if difference := _difference(row, motion(found)):
            raise RecordingError(
                f"{self.recorded} does not belong to this result: {row.task} {row.id} {difference}"
            )
        return Replay(row, found, None)

    def _run_again(self, rows: Sequence[Row]) -> dict[int, Replay]:
        header, task = self.result.header, rows[0].task
        # XLA's rounding depends on the size of the batch and on the processor; elsewhere it differs
        # anyway.
        same = device_name() == header.device
        seen: dict[int, Recording] = {}

        def watch(now: Header, task: str, ids: Sequence[int], trace: Trace) -> None:
            for lane, id in enumerate(ids):
                seen[id] = traced(id, self.problem_set.task(task), now.seed, trace, lane)

        again = rerun(
            str(self.path),
            header,
            {task: [row.id for row in rows]},
            _Steps(self.advanced),
            watch,
            batch_size=None if same else LANES,
            problem_set=self.problem_set,
        )
        now = {row.id: row for row in again.rows}
        return {row.id: Replay(row, seen[row.id], self._remark(row, now[row.id])) for row in rows}

    def _remark(self, then: Row, now: Row) -> str | None:
        """What to say where an episode came out differently when it was run again."""
        if _outcome(now) == _outcome(then):
            return None
        header, here = self.result.header, versions()
        changed = [
            f"{name} {header.versions.get(name)} then, {version} now"
            for name, version in here.items()
            if version != header.versions.get(name)
        ]
        if device_name() != header.device:
            changed.append(f"{header.device} then, {device_name()} now")
        why = f" ({'; '.join(changed)})" if changed else ""
        return (
            f"{then.task} {then.id} came out differently when run again: {_outcome(then)} in the "
            f"result, {_outcome(now)} now{why}"
        )


@dataclass(frozen=True)
class _Steps:
    """A run's progress, of which only the control steps are told on."""

    advance: Callable[[int], None]

    def begin(self, task: str, steps: int, done: int) -> None: ...

    def rows(self, rows: Sequence[Row]) -> None: ...


def _outcome(row: Row) -> str:
    reached = "reached" if row.reached else "not reached"
    if not row.collided:
        return f"{reached}, never collided"
    return f"{reached}, collided at step {row.first_collision_step} with {row.first_collision_link}"


def _difference(row: Row, motion: Motion) -> str | None:
    """How a recorded episode contradicts its row, or None."""
    if row.status != "ok" or row.position_error is None or row.orientation_error is None:
        return None
    away, turned = float(motion.position_error[-1]), float(motion.orientation_error[-1])
    if abs(away - row.position_error) > _SAME_POSITION:
        return f"ends {away:.3g} m from its goal there, {row.position_error:.3g} m in the row"
    if abs(turned - row.orientation_error) > _SAME_ORIENTATION:
        return f"ends {turned:.3g} rad from its goal there, {row.orientation_error:.3g} in the row"
    if bool(motion.touching.any()) != row.collided:
        return (
            "collides there and not in the row"
            if not row.collided
            else ("never collides there, and does in the row")
        )
    return None


def _listed(ids: Sequence[int]) -> str:
    if len(ids) > 8:
        return f"{len(ids)} problems from {min(ids)} to {max(ids)}"
    return ", ".join(map(str, ids))


def _key(row: Row) -> str:
    return f"{row.task}-{row.id}"
