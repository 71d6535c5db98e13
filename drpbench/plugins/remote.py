"""Remote policies: another process, which may be another environment, asked over a socket.

A message, in both directions (all numbers little-endian):

    4 bytes   b"DRP1"
    4 bytes   length of the header, unsigned
    header    JSON: {"kind": ...,
                     "arrays": [{"name": ..., "dtype": "<f4", "shape": [64, 7]}, ...], ...}
    arrays    their bytes one after the other, row by row

docs/your-policy.md has the conversation; examples/remote_policy.py is the other side of it.
"""

import json
import math
import socket
import struct
import time
from typing import Any

import numpy as np

from drpbench.contract import OBSERVED, HostObservation

from .errors import PolicyError
from .host import RESET_SHARE, Failed

PROTOCOL = 1
MAGIC = b"DRP1"
_DTYPES = ("<f4", "<f8", "<i4", "<i8", "|b1")
_LONGEST_HEADER, _MOST_BYTES = 1 << 20, 1 << 30
_LONGEST_REASON = 200  # characters of why something failed
_AGAIN = 0.2  # [s] between two attempts to connect


class Garbage(ValueError):
    """What came is no message of the protocol."""


def packed(kind: str, arrays: dict[str, np.ndarray] | None = None, **facts: Any) -> bytes:
    """One message. Booleans, integers and floats are sent as |b1, <i4 and <f4."""
    arrays = {name: _plain(array) for name, array in (arrays or {}).items()}
    described = [
        {"name": name, "dtype": array.dtype.str, "shape": array.shape}
        for name, array in arrays.items()
    ]
    header = json.dumps({"kind": kind, "arrays": described, **facts}).encode()
    parts = [MAGIC, struct.pack("<I", len(header)), header]
    return b"".join(parts + [array.tobytes() for array in arrays.values()])


def _plain(array: Any) -> np.ndarray:
    array = np.asarray(array)
    return array.astype({"b": "|b1", "i": "<i4", "u": "<i4"}.get(array.dtype.kind, "<f4"))


class Connection:
    """A socket on which whole messages come and go. Raises OSError, TimeoutError or Garbage."""

    def __init__(self, connected: socket.socket):
        self._socket, self._deadline = connected, math.inf

    @classmethod
    def to(cls, address: str, limit: float) -> "Connection":
        """`address`: host:port, or the path of a Unix socket (with a slash)."""
        if "/" in address:
            connected = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
            connected.settimeout(limit)
            connected.connect(address)
        else:
            host, port = _host_and_port(address)
            connected = socket.create_connection((host, port), limit)
            connected.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        return cls(connected)

    def ask(self, message: bytes, limit: float) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
        """The answer to a message, its header and arrays, within the limit [s]."""
        until = time.monotonic() + limit
        self._deadline = until
        self._wait()
        self.send(message)
        return self.receive(until - time.monotonic())

    def send(self, message: bytes) -> None:
        """One message."""
        self._socket.sendall(message)

    def receive(self, limit: float) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
        """The next message, its header and arrays, within the limit [s]."""
        self._deadline = time.monotonic() + limit
        start = self._receive(8)
        if start[:4] != MAGIC:
            raise Garbage(f"an answer begins with {bytes(start[:4])!r}, not {MAGIC!r}")
        (length,) = struct.unpack("<I", start[4:])
        if length > _LONGEST_HEADER:
            raise Garbage(f"a header of {length} bytes")
        try:
            header = json.loads(bytes(self._receive(length)))
            described = [
                (str(a["name"]), str(a["dtype"]), tuple(a["shape"]))
                for a in header.get("arrays", ())
            ]
        except (ValueError, TypeError, KeyError, AttributeError):
            raise Garbage("a header that is not the expected JSON") from None
        arrays = {}
        for name, dtype, shape in described:
            if dtype not in _DTYPES or not all(type(n) is int and n >= 0 for n in shape):
                raise Garbage(f"an array of {dtype} and shape {shape}")
            size = math.prod(shape) * np.dtype(dtype).itemsize
            if size > _MOST_BYTES:
                raise Garbage(f"an array of {size} bytes")
            arrays[name] = np.frombuffer(self._receive(size), dtype).reshape(shape)
        return header, arrays

    def close(self) -> None:
        self._socket.close()

    def _receive(self, count: int) -> bytearray:
        data, got = bytearray(count), 0
        while got < count:
            self._wait()
            more = self._socket.recv_into(memoryview(data)[got:])
            if not more:
                raise ConnectionError("the other side closed the connection")
            got += more
        return data

    def _wait(self) -> None:
        left = self._deadline - time.monotonic()
        if left <= 0.0:
            raise TimeoutError
        self._socket.settimeout(None if math.isinf(left) else left)


def _host_and_port(address: str) -> tuple[str, int]:
    host, _, port = address.rpartition(":")
    if not host or not port.isdecimal() or int(port) >= 1 << 16:
        raise PolicyError(
            "expected remote:HOST:PORT (remote:127.0.0.1:5555) or the path of a Unix socket "
            f"(remote:/tmp/policy.sock), got remote:{address}"
        )
    return host.strip("[]"), int(port)


class Remote:
    """A host policy that lives behind a socket. Keeps its own time, so that it can hang up."""

    arrays = "numpy"

    def __init__(self, address: str, time_limit: float):
        """Connects at once. Raises PolicyError."""
        self.address, self.time_limit = address, time_limit
        self._connection: Connection | None = None
        hello = self._connect(0.0, time_limit)
        self.privileged, self.about = hello["privileged"], hello["about"]
        self.told = hello["parameters"]
        """The parameters that it states."""
        self.parameters = {"remote": hello["name"], **self.told}
        self.failures: tuple[str, ...] = ()
        """Why it gave up each episode of the last batch, if it said so."""

    def reset(self, observation: HostObservation) -> None:
        """Raises Failed; PolicyError where a policy that hung or went away does not come back."""
        limit, self.failures = RESET_SHARE * self.time_limit, ()
        if self._connection is None:
            self._connect(self.time_limit, limit)
        header, _ = self._ask("reset", observation, "ready", limit)
        said = header.get("failures", ())
        if not isinstance(said, list | tuple) or not all(isinstance(one, str) for one in said):
            raise Failed("answer: its failures are no list of strings")
        self.failures = tuple(" ".join(one.split())[:_LONGEST_REASON] for one in said)

    def act(self, observation: HostObservation) -> np.ndarray:
        """Raises Failed."""
        _, arrays = self._ask("act", observation, "targets", self.time_limit)
        return arrays["targets"]

    def _ask(
        self, kind: str, observation: HostObservation, wanted: str, limit: float
    ) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
        """The header and arrays of the answer that is wanted. Raises Failed."""
        if self._connection is None:
            raise Failed("disconnected: the connection was lost before")
        try:
            header, arrays = self._connection.ask(packed(kind, _arrays(observation)), limit)
            if header.get("kind") == "error":
                said = " ".join(str(header.get("message", "")).split())
                raise Failed(f"raised: {said[:_LONGEST_REASON]}")
            if header.get("kind") != wanted or (wanted == "targets" and "targets" not in arrays):
                raise Garbage(f"{header.get('kind')!r} in answer to {kind!r}")
        except TimeoutError:
            self._hang_up()
            raise Failed(f"timeout: {kind} took longer than {limit:g} s") from None
        except OSError as error:
            self._hang_up()
            raise Failed(f"disconnected: {_reason(error)}") from None
        except Garbage as error:
            self._hang_up()
            raise Failed(f"answer: {error}") from None
        return header, arrays

    def _connect(self, patience: float, limit: float) -> dict[str, Any]:
        """Connects and says hello; for `patience` [s] again and again. Raises PolicyError."""
        name, until = f"remote:{self.address}", time.monotonic() + patience
        while self._connection is None:
            try:
                self._connection = Connection.to(self.address, limit)
            except OSError as error:
                if time.monotonic() >= until:
                    raise PolicyError(
                        f"{name}: nobody answers there ({_reason(error)}); start the policy first,"
                        " as docs/your-policy.md shows"
                    ) from None
                time.sleep(_AGAIN)
        try:
            header, _ = self._connection.ask(packed("hello", protocol=PROTOCOL), limit)
            return _checked(header)
        except TimeoutError:
            said = f"no answer to hello within {limit:g} s"
        except OSError as error:
            said = f"no answer to hello ({_reason(error)})"
        except Garbage as error:
            said = f"no drpbench policy: {error}"
        self._hang_up()
        raise PolicyError(f"{name}: {said}")

    def _hang_up(self) -> None:
        if self._connection is not None:
            self._connection.close()
        self._connection = None


def _arrays(observation: HostObservation) -> dict[str, np.ndarray]:
    """An observation's arrays by name; those of the obstacle models as `obstacles.position` and so
    on."""
    arrays = {name: getattr(observation, name) for name in OBSERVED}
    if observation.obstacles is not None:
        models = vars(observation.obstacles)
        arrays |= {f"obstacles.{name}": array for name, array in models.items()}
    return arrays


def _checked(hello: dict[str, Any]) -> dict[str, Any]:
    """A hello with everything in it. Raises Garbage."""
    if hello.get("kind") != "hello" or hello.get("protocol") != PROTOCOL:
        raise Garbage(
            f"it says {hello.get('kind')!r} of protocol {hello.get('protocol')!r},"
            f" not 'hello' of {PROTOCOL}"
        )
    found = {
        "name": hello.get("name", "unnamed"),
        "about": hello.get("about", ""),
        "privileged": hello.get("privileged", False),
        "parameters": hello.get("parameters", {}),
    }
    wanted = {"name": str, "about": str, "privileged": bool, "parameters": dict}
    for key, kind in wanted.items():
        if not isinstance(found[key], kind):
            raise Garbage(f"its {key} is no {kind.__name__}")
    for key, value in found["parameters"].items():
        plain = isinstance(value, bool | int | float | str)
        if not plain or (isinstance(value, float) and not math.isfinite(value)):
            raise Garbage(f"its parameter {key} is no number, bool or string")
    return found


def _reason(error: OSError) -> str:
    return (error.strerror or str(error) or type(error).__name__).lower()
