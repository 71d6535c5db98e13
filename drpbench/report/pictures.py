"""Small pictures of failures, for a report."""

import base64
import io
from collections.abc import Callable, Iterable, Mapping
from itertools import zip_longest
from pathlib import Path

import numpy as np
from PIL import Image

from drpbench.plugins.errors import PolicyError
from drpbench.policies.weights import WeightsError
from drpbench.problems import ProblemSet
from drpbench.ranking.board import labelled
from drpbench.recording import RecordingError, Replayer, motion
from drpbench.recording.offscreen import choose_platform
from drpbench.recording.stage import Stage
from drpbench.results import Result, ResultsError, Row
from drpbench.results.names import trajectories_file
from drpbench.results.trajectories import load_trajectories
from drpbench.robot import Robot

from .figures import reason
from .recordings import Instance

SIZE, DRAWN = (240, 180), (320, 240)  # [pixels] embedded; drawn larger, for smooth edges
_REFUSED = (RecordingError, ResultsError, PolicyError, WeightsError)


def telling(rows: Iterable[Row], count: int) -> list[Row]:
    """At most `count` failures that differ: one of each task and reason in turn, lowest ids
    first."""
    kinds: dict[tuple[str, int], list[Row]] = {}
    for row in sorted(rows, key=lambda row: (row.task, row.id)):
        if row.valid and not row.success and row.status == "ok":
            kinds.setdefault((row.task, reason(row)), []).append(row)
    turns = zip_longest(*kinds.values())
    return [row for turn in turns for row in turn if row is not None][:count]


def pictures(
    results: Mapping[str, Result],
    folder: Path,
    count: int,
    again: bool,
    remark: Callable[[str], None],
    advanced: Callable[[str], None] = lambda told: None,
    problem_set: ProblemSet | None = None,
) -> dict[Instance, str]:
    """Pictures of up to `count` failures of each policy, at the first collision or else at the end.

    Args:
        results: by file name, the files in `folder`.
        count: of each policy, at least 1.
        again: whether episodes without saved trajectories are run again; else they have no picture.
        remark: told in a line of what cannot be drawn.
        advanced: told what is being done.
        problem_set: what the results were made on, where it does not come with the package.

    Returns:
        Images of SIZE as `data:` addresses, by file name, task and id.

    Raises:
        RecordingError: nothing can be drawn here.
    """
    wanted: dict[tuple[str, str], list[Row]] = {}
    for name, row in _wanted(results, folder, count, again, remark):
        wanted.setdefault((name, row.task), []).append(row)
    if not wanted:
        return {}
    choose_platform()  # before anything takes long
    drawn: dict[Instance, str] = {}
    stages: dict[Robot, Stage] = {}
    try:
        for (name, task), rows in wanted.items():
            advanced(f"drawing {name}, {task}")
            try:
                replayer = Replayer(results[name], folder / name, problem_set=problem_set)
                found = replayer.replay(rows)
            except _REFUSED as error:
                remark(f"no pictures of {name}, {task}: {error}")
                continue
            for replay in found:
                if replay.remark:  # another episode than the row's
                    remark(replay.remark)
                    continue
                moved = motion(replay.episode)
                touching = np.flatnonzero(moved.touching)
                instant = int(touching[0]) if touching.size else replay.episode.instants - 1
                if (robot := replay.episode.world.robot) not in stages:
                    stages[robot] = Stage(*DRAWN, robot)
                picture = stages[robot].draw(replay.episode, moved, instant)
                drawn[name, task, replay.row.id] = _address(picture)
    finally:
        for stage in stages.values():
            stage.close()
    return drawn


def _wanted(
    results: Mapping[str, Result],
    folder: Path,
    count: int,
    again: bool,
    remark: Callable[[str], None],
) -> Iterable[tuple[str, Row]]:
    """The file and row of each failure to draw."""
    usable: dict[str, dict[tuple[str, int], tuple[str, Row]]] = {}
    labels = labelled(results)
    for name, result in results.items():
        rows, saved = result.rows, trajectories_file(folder / name)
        if not again:
            try:
                recorded = load_trajectories(saved) if saved.is_file() else ()
            except ResultsError as error:
                remark(f"no pictures of {name}: {error}")
                continue
            rows = [row for row in rows if f"{row.task}-{row.id}" in recorded]
        theirs = usable.setdefault(labels[name].header.policy, {})
        theirs |= {(row.task, row.id): (name, row) for row in rows}
    for theirs in usable.values():
        for row in telling((row for _, row in theirs.values()), count):
            yield theirs[row.task, row.id]


def _address(picture: np.ndarray) -> str:
    """A picture (height, width, 3) uint8 as a `data:` address."""
    file = io.BytesIO()
    small = Image.fromarray(picture).resize(SIZE, Image.Resampling.LANCZOS)
    small.save(file, "WEBP", quality=70, method=4)
    return "data:image/webp;base64," + base64.b64encode(file.getvalue()).decode()
