"""Jobs done each in a process of its own, forked from this one: what crashes or hangs costs its own
job alone."""

import os
import pickle
import select
import signal
import time
import traceback
from collections.abc import Callable, Iterator, Sequence
from typing import Any


class Lost(str):
    """Why a job has no answer, in words."""


def each_alone(
    function: Callable[[Any], Any], jobs: Sequence[Any], processes: int, patience: float
) -> Iterator[tuple[int, Any]]:
    """(number of the job, what `function` answers to it), as they come; a Lost where there is no
    answer.

    At most `processes` jobs run at once, and one that takes longer than `patience` [s] is killed.
    Answers are pickled. A child ends without Python's own farewell, so a library that aborts at
    exit does not matter.
    """
    waiting, running = list(enumerate(jobs))[::-1], dict[int, tuple[int, int, float, list[bytes]]]()
    try:
        while waiting or running:
            while waiting and len(running) < processes:
                number, job = waiting.pop()
                pid, pipe = _begun(function, job)
                running[pipe] = (number, pid, time.monotonic() + patience, [])
            soonest = min(until for _, _, until, _ in running.values())
            ready, _, _ = select.select(
                list(running), [], [], max(0.0, soonest - time.monotonic()) + 0.01
            )
            for pipe in ready:
                number, pid, _, parts = running[pipe]
                if part := os.read(pipe, 1 << 16):
                    parts.append(part)
                    continue
                del running[pipe]
                os.close(pipe)
                yield number, _answer(b"".join(parts), os.waitpid(pid, 0)[1])
            now = time.monotonic()
            for pipe, (number, pid, until, _) in list(running.items()):
                if now >= until:
                    del running[pipe]
                    _ended(pid, pipe)
                    yield number, Lost(f"did not end within {patience:g} s, and was killed")
    finally:
        for pipe, (_, pid, _, _) in running.items():
            _ended(pid, pipe)


def _begun(function: Callable[[Any], Any], job: Any) -> tuple[int, int]:
    """The child's process id, and where its answer can be read."""
    here, there = os.pipe()
    pid = os.fork()
    if pid:
        os.close(there)
        return pid, here
    try:
        os.close(here)
        with os.fdopen(there, "wb") as out:
            pickle.dump(function(job), out)
        os._exit(0)
    except BaseException:
        traceback.print_exc()
        os._exit(1)
    raise AssertionError


def _answer(said: bytes, status: int) -> Any:
    if os.WIFSIGNALED(status):
        return Lost(f"crashed ({signal.Signals(os.WTERMSIG(status)).name})")
    if os.WEXITSTATUS(status):
        return Lost("raised an error")
    return pickle.loads(said)


def _ended(pid: int, pipe: int) -> None:
    os.kill(pid, signal.SIGKILL)
    os.waitpid(pid, 0)
    os.close(pipe)
