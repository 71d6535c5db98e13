"""MCAP files of a run's episodes, in one folder."""

import datetime
from collections.abc import Callable, Collection, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Self

from drpbench.problems import ProblemSet, TaskProblems
from drpbench.ranking.submission import set_of
from drpbench.results import Header, Result
from drpbench.results import load as load_result
from drpbench.rollout import Trace

from .episode import Recording, episode_name, traced
from .mcap_file import TEMPORARY, write_mcap
from .reaction import dcp_rmp_of
from .recorded import is_whole
from .replay import Replayer


class Recorder:
    """Writes `FDO-00017.mcap` and the like into `folder`; a file that is there is replaced.

    `only` says per task which instances `watch` takes; None takes all. As a context it watches a
    run, and all files are written when it is left. Where the run went on with one that had been
    broken off, rows of the file `result` may have none yet, or one of an older run: these episodes
    are replayed then. `problem_set` is the one that the run is of, where that does not come with
    the package.
    """

    def __init__(
        self,
        folder: Path,
        only: Mapping[str, Collection[int]] | None = None,
        result: Path | None = None,
        problem_set: ProblemSet | None = None,
        wrote: Callable[[], None] = lambda: None,
    ):
        """`wrote` is called for each file of a run once it is there, from another thread while the
        run is watched."""
        self.folder, self.only, self.result = folder, only, result
        self._wrote, self._written = wrote, set[Path]()
        self._given = problem_set
        self._thread = ThreadPoolExecutor(1)
        self._batch: Future | None = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        self._thread.shutdown()
        self._finish()
        if kind is None and self.result:
            self._complete(load_result(self.result), self.result)

    def write(self, header: Header, episode: Recording) -> Path:
        """Writes one episode of a run; returns the file's path. Raises RecordingError where that
        fails."""
        problems = self._problems(header, episode.task)
        about = {
            "task": episode.task,
            "id": str(episode.id),
            "family": problems.family[episode.id],
            "policy": header.policy,
            "seed": str(header.seed),
            "problem_set": header.problem_set,
            "problem_set_sha256": header.problem_set_sha256,
            **{f"version {name}": version for name, version in header.versions.items()},
        }
        path = self._path(episode.name)
        write_mcap(path, episode, about, dcp_rmp_of(header.policy_parameters))
        self._written.add(path)
        self._wrote()
        return path

    def watch(self, header: Header, task: str, ids: Sequence[int], trace: Trace) -> None:
        """Writes the episodes of a batch while the next one runs: simulating leaves Python alone.

        Raises RecordingError where those of the batch before could not be written.
        """
        self._finish()
        self._batch = self._thread.submit(self._write_batch, header, task, list(ids), trace)

    def _finish(self) -> None:
        batch, self._batch = self._batch, None
        if batch:
            batch.result()

    def _write_batch(self, header: Header, task: str, ids: list[int], trace: Trace) -> None:
        problems = self._problems(header, task)
        for lane, id in enumerate(ids):
            if self._takes(task, id):
                self.write(header, traced(id, problems, header.seed, trace, lane))

    def _problems(self, header: Header, task: str) -> TaskProblems:
        return set_of(str(self.folder), header, self._given).task(task)

    def _path(self, name: str) -> Path:
        return self.folder / f"{name}.mcap"

    def _complete(self, result: Result, path: Path) -> None:
        """Writes what is missing of the rows of a finished run, and removes what a crash left half
        written."""
        begun = datetime.datetime.fromisoformat(result.header.created).timestamp()
        for task in result.header.tasks:
            rows = [row for row in result.rows if row.task == task and self._takes(task, row.id)]
            files = [self._path(episode_name(row.task, row.id)) for row in rows]
            missing = [
                row
                for row, file in zip(rows, files, strict=True)
                if not is_whole(file) or file.stat().st_mtime < begun
            ]
            for _ in range(len({*files} - self._written) - len(missing)):
                self._wrote()  # by the run that this one goes on with
            if missing:
                for replay in Replayer(result, path, problem_set=self._given).replay(missing):
                    self.write(result.header, replay.episode)
        for half in self.folder.glob(TEMPORARY):
            half.unlink(missing_ok=True)

    def _takes(self, task: str, id: int) -> bool:
        return self.only is None or id in self.only[task]
