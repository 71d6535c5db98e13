"""Training states on disk, each whole or not at all, so that training resumes exactly."""

from __future__ import annotations

from pathlib import Path

import jax
import orbax.checkpoint as ocp

from drpbench.errors import DrpbenchError

from .cloning import TrainingState


class CheckpointError(DrpbenchError):
    """A folder whose checkpoints are missing, damaged, or of another network."""


class Checkpoints:
    """The last two states of a run, in a folder of its own."""

    def __init__(self, folder: Path):
        self._folder = folder.resolve()
        self._manager = ocp.CheckpointManager(
            self._folder, options=ocp.CheckpointManagerOptions(max_to_keep=2, create=True)
        )

    @property
    def latest(self) -> int | None:
        """The last saved step, None if there is none."""
        return self._manager.latest_step()

    def save(self, state: TrainingState) -> None:
        """Saves a state, and waits until it is safe."""
        self._manager.save(int(state.step), args=ocp.args.StandardSave(_plain(state)))
        self._manager.wait_until_finished()

    def load(self, like: TrainingState) -> TrainingState:
        """The last state. `like` gives structure, shapes and devices. Raises CheckpointError."""
        if self.latest is None:
            raise CheckpointError(
                f"{self._folder} holds no checkpoint to resume: leave out --resume"
            )
        template = jax.tree.map(ocp.utils.to_shape_dtype_struct, _plain(like))
        try:
            leaves = self._manager.restore(self.latest, args=ocp.args.StandardRestore(template))
        except Exception as error:  # orbax raises many kinds, over many lines
            reason = str(error).strip().splitlines()[0]
            raise CheckpointError(
                f"{self._folder}/{self.latest} cannot be resumed: damaged, or of another "
                f"network ({reason})"
            ) from None
        return jax.tree.unflatten(jax.tree.structure(like), jax.tree.leaves(leaves))

    def close(self) -> None:
        self._manager.close()


def _plain(state: TrainingState) -> dict:
    """The leaves by number: what is stored depends on no class of ours or of any library's."""
    leaves = jax.tree.leaves(state)
    return {f"{number:05d}": leaf for number, leaf in enumerate(leaves)}
