"""Where demonstrations come from while training runs: a folder, or straight from the expert.

Either way they lie on the accelerator, a fixed number of them, and training draws from those.
"""

from __future__ import annotations

import itertools
import queue
import threading
from pathlib import Path
from typing import Protocol, runtime_checkable

import jax
import numpy as np

from drpbench.generation.training_problems import TRAINING_STREAM
from drpbench.robot import PANDA, Robot

from .demonstrations import DataError, Demonstrations, join, read, read_manifest
from .production import SHARD, Production

_BLOCK = 256  # demonstrations that replace older ones at once


@runtime_checkable
class Feed(Protocol):
    """A source of demonstrations."""

    @property
    def about(self) -> str:
        """In words, for a model card."""
        ...

    def begin(self) -> Demonstrations:
        """The first ones, on the host."""
        ...

    def refresh(self, resident: Demonstrations) -> Demonstrations:
        """The same, with some replaced by newer ones if there are any."""
        ...


class Folder:
    """What `drpbench data` and `drpbench correct` wrote, in one folder or several. Raises
    DataError."""

    def __init__(self, *folders: Path):
        self._demonstrations = join([read(folder) for folder in folders])
        self.about = "; and ".join(_about(folder) for folder in folders)

    def begin(self) -> Demonstrations:
        return self._demonstrations

    def refresh(self, resident: Demonstrations) -> Demonstrations:
        return resident


def _about(folder: Path) -> str:
    manifest = read_manifest(folder)
    rows = manifest["shards"].values()
    drawn, solved, obstructed = (
        sum(row[name] for row in rows) for name in ("drawn", "solved", "obstructed")
    )
    of = (
        f"of {drawn} problems drawn"
        if manifest["stream"] == TRAINING_STREAM
        else f"{manifest['stream']} after {drawn} demonstrations"
    )
    return f"{solved} expert paths, {obstructed} of them to goals out of reach; {of}"


class Stream:
    """New problems for ever, solved in a thread beside training; the newest `capacity` are kept.

    A context manager. Which step sees which demonstration depends on the machine's speed, so such a
    training is not repeated exactly; for that, train from a folder.
    """

    def __init__(
        self,
        capacity: int,
        first: int = 0,
        workers: int | None = None,
        robot: Robot = PANDA,
    ):
        """`first` is the number of the first problem."""
        if capacity < _BLOCK:
            raise DataError(f"--capacity {capacity}: at least {_BLOCK} demonstrations are kept")
        self._capacity, self._first = capacity, first
        self._workers, self._robot = workers, robot
        self._blocks: queue.Queue[Demonstrations | BaseException] = queue.Queue(maxsize=8)
        self._stopped = threading.Event()
        self._thread = threading.Thread(target=self._produce, daemon=True)
        self._next = 0  # where the next block goes
        self.made = 0
        """Demonstrations so far."""

    @property
    def about(self) -> str:
        return f"{self.made} expert paths, made while training, the newest {self._capacity} kept"

    def __enter__(self) -> Stream:
        self._thread.start()
        return self

    def __exit__(self, *error: object) -> None:
        self._stopped.set()
        self._thread.join()

    def begin(self) -> Demonstrations:
        """The first block, repeated until the capacity is full."""
        block = self._taken(self._blocks.get())
        self._next = _BLOCK % self._capacity
        return jax.tree.map(lambda leaf: np.resize(leaf, (self._capacity, *leaf.shape[1:])), block)

    def refresh(self, resident: Demonstrations) -> Demonstrations:
        while True:
            try:
                block = self._taken(self._blocks.get_nowait())
            except queue.Empty:
                return resident
            resident = _replace(resident, block, self._next)
            self._next = (self._next + _BLOCK) % (self._capacity - self._capacity % _BLOCK)

    def _taken(self, block: Demonstrations | BaseException) -> Demonstrations:
        if isinstance(block, BaseException):
            raise block
        self.made += block.count
        return block

    def _produce(self) -> None:
        try:
            with Production(workers=self._workers, robot=self._robot) as production:
                self._solve(production)
        except BaseException as error:  # raised where a block is waited for
            self._blocks.put(error)

    def _solve(self, production: Production) -> None:
        kept: list[Demonstrations] = []
        for first in itertools.count(self._first, SHARD):
            for solved in production.solved(range(first, first + SHARD)):
                kept = [join([*kept, solved])]
                while kept[0].count >= _BLOCK:
                    block = jax.tree.map(lambda leaf: leaf[:_BLOCK], kept[0])
                    kept = [jax.tree.map(lambda leaf: leaf[_BLOCK:], kept[0])]
                    while not self._stopped.is_set():
                        try:
                            self._blocks.put(block, timeout=0.5)
                            break
                        except queue.Full:
                            continue
                if self._stopped.is_set():
                    return


@jax.jit
def _write(leaf: jax.Array, block: jax.Array, first: jax.Array | int) -> jax.Array:
    return jax.lax.dynamic_update_slice_in_dim(leaf, block.astype(leaf.dtype), first, 0)


def _replace(resident: Demonstrations, block: Demonstrations, first: int) -> Demonstrations:
    return jax.tree.map(lambda leaf, new: _write(leaf, new, first), resident, block)
