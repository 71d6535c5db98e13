"""MCAP files of a run's episodes, in one folder."""

from collections.abc import Collection, Mapping, Sequence
from pathlib import Path

from drpbench.evaluation import Header
from drpbench.evaluation.rollout import Trace
from drpbench.problems import load

from .episode import Episode, traced
from .mcap_file import write_mcap
from .reaction import dcp_rmp_of


class Recorder:
    """Writes `FDO-00017.mcap` and the like into `folder`; a file that is there is replaced.

    `only` says per task which instances `watch` takes; None takes all.
    """

    def __init__(self, folder: Path, only: Mapping[str, Collection[int]] | None = None):
        self.folder, self.only = folder, only

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
        """Writes the episodes of a batch, as the run hands them over."""
        problems = load(task)
        for lane, id in enumerate(ids):
            if self.only is None or id in self.only[task]:
                self.write(header, traced(task, id, problems, header.seed, trace, lane))
