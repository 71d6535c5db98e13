"""A policy in a process of its own: Python 3.8 or newer and NumPy, nothing of drpbench. Copy this
file.

python examples/remote_policy.py 127.0.0.1:5555     # or the path of a Unix socket: /tmp/policy.sock
drpbench run --task FDO --problems 20 --policy remote:127.0.0.1:5555
"""

import json
import os
import socket
import struct
import sys
import traceback
from types import SimpleNamespace

import numpy as np


class Approach:
    """Yours: change this class, and leave the rest. Arrays are NumPy's, with B instances in
    front."""

    name, privileged, parameters = "approach", False, {"gain": 0.1, "most": 0.05}

    def reset(self, observation):
        """New episodes begin: forget the old ones."""

    def act(self, observation):
        """Absolute joint position targets (B, 7) [rad]."""
        away = observation.goal_joints - observation.joint_position
        return observation.joint_position + np.clip(0.1 * away, -0.05, 0.05)


def exactly(stream, count):
    data = stream.read(count)
    if len(data) < count:
        raise ConnectionError("the benchmark hung up")
    return data


def receive(stream):
    """One message: its kind, and its arrays by name."""
    magic, length = struct.unpack("<4sI", exactly(stream, 8))
    if magic != b"DRP1":
        raise ConnectionError("whoever called is no drpbench")
    header = json.loads(exactly(stream, length).decode())
    arrays = {}
    for array in header["arrays"]:
        size = int(np.prod(array["shape"])) * np.dtype(array["dtype"]).itemsize
        data = bytearray(exactly(stream, size))  # so that the array can be written on
        arrays[array["name"]] = np.frombuffer(data, array["dtype"]).reshape(array["shape"])
    return header["kind"], SimpleNamespace(**arrays)


def send(stream, kind, targets=None, **facts):
    arrays, data = [], b""
    if targets is not None:
        arrays = [{"name": "targets", "dtype": "<f4", "shape": targets.shape}]
        data = targets.tobytes()
    header = json.dumps(dict(facts, kind=kind, arrays=arrays)).encode()
    stream.write(struct.pack("<4sI", b"DRP1", len(header)) + header + data)
    stream.flush()


def answer(policy, kind, observation):
    if kind == "hello":
        facts = {"name": policy.name, "privileged": policy.privileged}
        return dict(facts, kind="hello", protocol=1, parameters=policy.parameters)
    if kind == "reset":
        policy.reset(observation)
        return {"kind": "ready"}
    return {"kind": "targets", "targets": np.asarray(policy.act(observation), "<f4")}


def converse(policy, connection):
    with connection.makefile("rb") as incoming, connection.makefile("wb") as outgoing:
        while True:
            kind, observation = receive(incoming)
            try:
                told = answer(policy, kind, observation)
            except Exception as error:  # the benchmark notes it, and goes on with other instances
                traceback.print_exc()
                told = {"kind": "error", "message": type(error).__name__ + ": " + str(error)}
            send(outgoing, **told)


def serve(policy, address):
    """Answers one benchmark after the other. For your own machine: whoever reaches it is let in."""
    if "/" in address:
        if os.path.exists(address):
            os.remove(address)
        listener = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        listener.bind(address)
        listener.listen(1)
    else:
        host, _, port = address.rpartition(":")
        listener = socket.create_server((host, int(port)))
    print("listening on", address, flush=True)
    while True:
        connection, _ = listener.accept()
        try:
            with connection:
                if "/" not in address:  # small answers at once
                    connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                converse(policy, connection)
        except OSError as gone:
            print(gone, flush=True)


if __name__ == "__main__":
    serve(Approach(), sys.argv[1] if len(sys.argv) > 1 else "127.0.0.1:5555")
