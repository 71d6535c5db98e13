"""MCAP files of a run's episodes, in one folder."""

from collections.abc import Collection, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Self

from drpbench.evaluation import Header
from drpbench.evaluation.rollout import Trace
from drpbench.problems import load

from .episode import Episode, traced
from .mcap_file import write_mcap
from .reaction import dcp_rmp_of


class Recorder:
    """Writes `FDO-00017.mcap` and the like into `folder`; a file that is there is replaced.

    `only` says per task which instances `watch` takes; None takes all. As a context it watches a run, and
    all files are written when it is left.
    """

    def __init__(self, folder: Path, only: Mapping[str, Collection[int]] | None = None):
        self.folder, self.only = folder, only
        self._thread = ThreadPoolExecutor(1)
        self._batch: Future | None = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_) -> None:
        self._thread.shutdown()
        self._finish()

    def write(self, header: Header, episode: Episode) -> Path:
        """Writes one episode of a run; returns the file's path. Raises RecordingError where that fails."""
        about = {
            "task": episode.task,
            "id": str(episode.id),
            "family": load(episode.task).family[episode.id],
            "policy": header.policy,
            "seed": str(header.seed),
            "problem_set": header.problem_set,
            "problem_set_sha256": header.problem_set_sha256,
            **{f"version {name}": version for name, version in header.versions.items()},
        }
        path = self.folder / f"{episode.name}.mcap"
        write_mcap(path, episode, about, dcp_rmp_of(header.policy_parameters))
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
        problems = load(task)
        for lane, id in enumerate(ids):
            if self.only is None or id in self.only[task]:
                self.write(header, traced(task, id, problems, header.seed, trace, lane))
