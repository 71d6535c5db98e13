"""MCAP files of a run's episodes, in one folder."""

from collections.abc import Collection, Mapping, Sequence
from pathlib import Path

from drpbench import __version__
from drpbench.evaluation.rollout import Trace
from drpbench.problems import load

from .episode import Episode, traced
from .mcap_file import write_mcap
from .reaction import dcp_rmp_of


class Recorder:
    """Writes `FDO-00017.mcap` and the like into `folder`; a file that is there is replaced.

    `policy`, its `parameters` and the `seed` are those of the run's header. `only` says per task which
    instances `watch` takes; None takes all.
    """

    def __init__(
        self,
        folder: Path,
        policy: str,
        parameters: Mapping[str, object],
        seed: int,
        only: Mapping[str, Collection[int]] | None = None,
    ):
        self.folder, self.policy, self.seed, self.only = folder, policy, seed, only
        self._module = dcp_rmp_of(parameters)

    def write(self, episode: Episode) -> Path:
        """Writes one episode; returns the file's path. Raises RecordingError where that fails."""
        problems = load(episode.task)
        about = {
            "task": episode.task,
            "id": str(episode.id),
            "family": problems.family[episode.id],
            "policy": self.policy,
            "seed": str(self.seed),
            "problem_set": problems.name,
            "problem_set_sha256": problems.sha256,
            "drpbench": __version__,
        }
        path = self.folder / f"{episode.name}.mcap"
        write_mcap(path, episode, about, self._module)
        return path

    def watch(self, task: str, ids: Sequence[int], trace: Trace) -> None:
        """Writes the episodes of a batch, as the run hands them over."""
        problems = load(task)
        for lane, id in enumerate(ids):
            if self.only is None or id in self.only[task]:
                self.write(traced(task, id, problems, self.seed, trace, lane))
