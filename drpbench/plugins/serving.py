"""A policy served to a benchmark in another process: the other side of `remote.py`.

    python -m drpbench.plugins.serving NAME SOCKET TIME_LIMIT [NAME=VALUE ...]

It sees what comes through the socket, and nothing else of the process that keeps the score.
"""

import os
import socket
import sys
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from drpbench.compile import jit
from drpbench.contract import OBSERVED, Observation
from drpbench.errors import DrpbenchError
from drpbench.geometry import Primitives

from .errors import told
from .host import Failed, Hosted
from .registry import Choice, choose
from .remote import PROTOCOL, Connection, packed

REFUSED = ".refused"
"""Of the file beside the socket that says why a policy cannot be served."""
LANES = 64
"""Smallest batch that a policy in JAX is compiled for."""


class Served:
    """A policy of any kind as a conversation: what is asked, and what is answered."""

    def __init__(self, name: str, choice: Choice):
        self._name, self._choice = name, choice
        self._carry: Any = None
        self._clock = 0

    def answer(self, kind: str, arrays: dict[str, np.ndarray]) -> bytes:
        """The message that answers one of this kind. An answer that is none is an error's."""
        try:
            if kind == "hello":
                return packed(
                    "hello",
                    protocol=PROTOCOL,
                    name=self._name,
                    about=str(getattr(self._choice.policy, "about", "")),
                    privileged=bool(self._choice.policy.privileged),
                    parameters={**self._choice.parameters},
                )
            observation, count = _observation(arrays)
            if kind == "reset":
                return packed("ready", failures=self._reset(observation, count))
            return packed("targets", {"targets": self._act(observation, count)})
        except Failed as failed:
            return packed("error", message=str(failed).removeprefix("raised: "))
        except Exception as error:  # their own code
            return packed("error", message=told(error))

    def _reset(self, observation: Observation, count: int) -> tuple[str, ...]:
        """Why the policy gives up each episode; "" where it does not."""
        policy, self._clock = self._choice.policy, 0
        if isinstance(policy, Hosted):
            policy.reset(observation, count)
            return policy.failures(count)
        self._carry = _init(policy, _filled(observation, count))
        return ("",) * count

    def _act(self, observation: Observation, count: int) -> np.ndarray:
        policy = self._choice.policy
        if isinstance(policy, Hosted):
            return policy.act(observation, count)
        seen = _filled(observation, count)
        targets, self._carry = _step(policy, seen, self._carry, np.int32(self._clock))
        self._clock += 1
        return np.asarray(targets)[:count]


def _observation(arrays: dict[str, np.ndarray]) -> tuple[Observation, int]:
    models = {
        name.removeprefix("obstacles."): jnp.asarray(array)
        for name, array in arrays.items()
        if name.startswith("obstacles.")
    }
    seen = {name: jnp.asarray(arrays[name]) for name in OBSERVED}
    obstacles = Primitives(**models) if models else None
    return Observation(**seen, obstacles=obstacles), len(arrays["joint_position"])


def _filled(observation: Observation, count: int) -> Observation:
    """The instances again and again, up to a size that is compiled for."""
    lanes = np.arange(max(LANES, count)) % count
    return jax.tree.map(lambda leaf: leaf[lanes], observation)


@jit
def _init(policy: Any, observation: Observation) -> Any:
    return jax.vmap(policy.init)(observation)


@jit
def _step(policy: Any, observation: Observation, carry: Any, clock: jax.Array) -> tuple[Any, Any]:
    """As a run has it, with random keys of its own: which instances these are is not told."""
    lanes = len(observation.joint_position)
    keys = jax.random.split(jax.random.fold_in(jax.random.key(0), clock), lanes)
    return jax.vmap(policy.act)(observation, carry, keys)


def main(name: str, path: str, time_limit: str, *arguments: str) -> None:
    """Serves one benchmark after the other until it is ended."""
    try:
        served = Served(name, choose(name, arguments, float(time_limit)))
    except (DrpbenchError, ValueError) as error:
        Path(path + REFUSED).write_text(str(error))
        sys.exit(2)
    listener = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    listener.bind(path + ".making")
    listener.listen(1)
    os.replace(path + ".making", path)  # it is there once it can be called
    while True:
        accepted, _ = listener.accept()
        connection = Connection(accepted)
        try:
            while True:
                header, arrays = connection.receive(float("inf"))
                connection.send(served.answer(str(header.get("kind")), arrays))
        except (OSError, ValueError):  # it hung up, or is no benchmark
            connection.close()


if __name__ == "__main__":
    main(*sys.argv[1:])
