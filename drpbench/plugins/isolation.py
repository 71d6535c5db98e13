"""A policy kept out of the process that keeps the score: it lives in a child of it, and sees what
comes through a socket.

A policy in the scorer's own process could replace what scores it, or read the simulator's state.
docs/trust.md says what this protects from, and what not.
"""

import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from drpbench.contract import EPISODE, OF_THE_WORLD, Episode
from drpbench.robot import PANDA, Robot

from .errors import PolicyError
from .host import TIME_LIMIT
from .registry import FROM_FILE, POLICIES, Choice, hosted_over, split
from .remote import Remote
from .serving import REFUSED

PATIENCE = 120.0
"""[s] that a policy may take to be made."""


def is_ours(name: str) -> bool:
    """Whether all of a policy's code comes with drpbench: one by name, or weights of a network of
    ours. Then there is nobody to keep out."""
    base, _ = split(name)
    kind, colon, rest = base.partition(":")
    if not colon:
        return base in POLICIES or base.endswith(".safetensors")
    if kind == "ompl":
        return True
    return kind in FROM_FILE and rest.endswith(".safetensors") and ":" not in rest


@contextmanager
def isolated(
    name: str,
    arguments: Sequence[str] = (),
    time_limit: float = TIME_LIMIT,
    robot: Robot = PANDA,
    episode: Episode = EPISODE,
) -> Iterator[Choice]:
    """The policy that `name` describes (`registry.choose`), in a process of its own while the
    context lasts. What goes over it (`+dcp-rmp`) is the scorer's. Its parameters are those that it
    states itself.

    Raises PolicyError.
    """
    base, wrappers = split(name)
    if base.startswith("remote:"):
        raise PolicyError(f"{name}: is in a process of its own already: leave out --isolated")
    with tempfile.TemporaryDirectory(prefix="drpbench-") as folder:
        path = str(Path(folder) / "policy")
        command = [sys.executable, "-m", "drpbench.plugins.serving", base, path, f"{time_limit:g}"]
        process = subprocess.Popen([*command, *arguments])
        try:
            _await(process, path, base)
            policy = Remote(path, time_limit)
            world = dict(zip(OF_THE_WORLD, (robot, episode.period), strict=True))
            yield hosted_over(
                policy, lambda: Remote(path, time_limit), wrappers, policy.told, time_limit, world
            )
        finally:
            process.terminate()
            process.wait()


def _await(process: subprocess.Popen, path: str, name: str) -> None:
    until = time.monotonic() + PATIENCE
    while not Path(path).exists():
        if process.poll() is not None:
            refusal = Path(path + REFUSED)
            ended = f"{name}: its process ended at once"
            raise PolicyError(refusal.read_text() if refusal.exists() else ended)
        if time.monotonic() >= until:
            raise PolicyError(f"{name}: was not made within {PATIENCE:g} s in a process of its own")
        time.sleep(0.05)
