"""Policies behind a socket: the example's side and ours, byte by byte, and whoever else may answer
there."""

import ast
import importlib.util
import json
import socket
import struct
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest

from drpbench.contract import OBSERVED, HostObservation
from drpbench.geometry import Primitives
from drpbench.plugins.errors import PolicyError
from drpbench.plugins.host import Failed
from drpbench.plugins.registry import choose
from drpbench.plugins.remote import Remote, packed

EXAMPLE = Path(__file__).parents[2] / "examples" / "remote_policy.py"
LIMIT = 0.4  # [s]


@pytest.fixture(scope="module")
def example():
    spec = importlib.util.spec_from_file_location("remote_policy", EXAMPLE)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def free_port():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def in_background(function, *arguments):
    threading.Thread(target=function, args=arguments, daemon=True).start()


def connected(address, limit=LIMIT, patience=10.0):
    until = time.monotonic() + patience
    while True:
        try:
            return Remote(address, limit)
        except PolicyError as error:
            if "nobody answers" not in str(error) or time.monotonic() > until:
                raise
            time.sleep(0.02)


@pytest.fixture(params=["tcp", "unix"])
def address(request, tmp_path):
    if request.param == "tcp":
        return f"127.0.0.1:{free_port()}"
    return str(tmp_path / "policy.sock")


def observation(count=3, seed=0):
    rng = np.random.default_rng(seed)

    def some(*shape):
        return rng.normal(size=(count, *shape)).astype(np.float32)

    return HostObservation(
        joint_position=some(7),
        joint_velocity=some(7),
        goal_joints=some(7),
        goal_position=some(3),
        goal_quaternion=some(4),
        scene_points=some(2048, 3),
        scene_mask=some(2048) > 0,
        robot_points=some(256, 3),
    )


def test_both_sides_understand_each_other(example, address):
    class Keeps(example.Approach):
        def reset(self, observation):
            self.first = observation

        def act(self, observation):
            self.last = observation
            observation.joint_position += 0.0  # may be written on
            return super().act(observation)

    policy = Keeps()
    in_background(example.serve, policy, address)
    remote = connected(address)
    assert remote.parameters == {"remote": "approach", "gain": 0.1, "most": 0.05}
    assert remote.privileged is False
    for seed, count in ((0, 3), (1, 64), (2, 1)):
        first, then = observation(count, seed), observation(count, seed + 10)
        remote.reset(first)
        targets = remote.act(then)
        for sent, received in ((first, policy.first), (then, policy.last)):
            for name, array in vars(sent).items():
                if array is not None:
                    found = getattr(received, name)
                    assert found.dtype == array.dtype
                    np.testing.assert_array_equal(found, array)
        away = 0.1 * (then.goal_joints - then.joint_position)
        np.testing.assert_allclose(targets, then.joint_position + np.clip(away, -0.05, 0.05))


def test_a_privileged_remote_gets_the_obstacles_models(example):
    class Knows(example.Approach):
        privileged = True

        def reset(self, observation):
            self.first = observation

    policy, address = Knows(), f"127.0.0.1:{free_port()}"
    in_background(example.serve, policy, address)
    remote = connected(address)
    assert remote.privileged is True
    seen = observation()
    seen.obstacles = Primitives(
        kind=np.zeros((3, 2), np.int32),
        half_size=np.ones((3, 2, 3), np.float32),
        position=np.full((3, 2, 3), 0.5, np.float32),
        rotation=np.tile(np.eye(3, dtype=np.float32), (3, 2, 1, 1)),
        mask=np.array([[True, False]] * 3),
    )
    remote.reset(seen)
    for name, array in vars(seen.obstacles).items():
        found = getattr(policy.first, f"obstacles.{name}")
        assert found.dtype == array.dtype
        np.testing.assert_array_equal(found, array)


def test_failures_name_their_reason_and_the_next_batch_is_asked_again(example):
    class Moody(example.Approach):
        def act(self, observation):
            mood = float(observation.joint_position[0, 0])
            if mood == 1.0:
                raise ValueError("not\nthis one")
            if mood == 2.0:
                time.sleep(2 * LIMIT)
            return super().act(observation)

    address = f"127.0.0.1:{free_port()}"
    in_background(example.serve, Moody(), address)
    remote, seen = connected(address), observation()
    for mood, status in ((1.0, "raised: ValueError: not this one"), (2.0, "timeout: act took")):
        remote.reset(seen)
        seen.joint_position[0, 0] = mood
        with pytest.raises(Failed, match=status) as failed:
            remote.act(seen)
        assert "\n" not in str(failed.value)
        seen.joint_position[0, 0] = 0.0
        remote.reset(seen)  # which waits for the one that is late, and connects anew
        assert remote.act(seen).shape == (3, 7)


def scripted(*answers):
    """A listener that answers each message with the next of these bytes (None: hangs up)."""
    listener = socket.create_server(("127.0.0.1", 0))

    def serve():
        while True:
            connection, _ = listener.accept()
            with connection:
                for answer in answers:
                    if not connection.recv(1 << 22) or answer is None:
                        break
                    connection.sendall(answer)
                else:
                    time.sleep(3 * LIMIT)

    in_background(serve)
    return f"127.0.0.1:{listener.getsockname()[1]}"


def hello(**changes):
    return packed(
        "hello", **{"protocol": 1, "name": "x", "privileged": False, "parameters": {}} | changes
    )


def raw(header):
    text = header if isinstance(header, bytes) else json.dumps(header).encode()
    return b"DRP1" + struct.pack("<I", len(text)) + text


@pytest.mark.parametrize(
    ("answer", "said"),
    [
        (b"HTTP/1.1 400 Bad Request\r\n\r\n", "an answer begins with b'HTTP', not b'DRP1'"),
        (b"DRP1\xff\xff\xff\xff", "a header of 4294967295 bytes"),
        (raw(b"nonsense"), "not the expected JSON"),
        (raw([1, 2]), "not the expected JSON"),
        (raw({"kind": "hello", "arrays": [{"name": "x"}]}), "not the expected JSON"),
        (raw({"arrays": [{"name": "x", "dtype": "|O8", "shape": [1]}]}), "an array of |O8"),
        (raw({"arrays": [{"name": "x", "dtype": "<f4", "shape": [-1]}]}), "shape (-1,)"),
        (raw({"arrays": [{"name": "x", "dtype": "<f4", "shape": [1 << 40]}]}), "bytes"),
        (hello(protocol=2), "of protocol 2, not 'hello' of 1"),
        (packed("ready"), "it says 'ready'"),
        (hello(privileged="yes"), "privileged is no bool"),
        (hello(parameters={"a": [1]}), "parameter a is no number"),
        (raw(b'{"kind": "hello", "protocol": 1, "parameters": {"a": NaN}}'), "parameter a"),
        (hello()[:20], "no answer to hello within 0.4 s"),
        (None, "the other side closed the connection"),
    ],
)
def test_who_speaks_garbage_is_refused_in_one_line(answer, said):
    address = scripted(answer)
    with pytest.raises(PolicyError) as error:
        Remote(address, LIMIT)
    assert said in str(error.value) and "\n" not in str(error.value)
    assert str(error.value).startswith(f"remote:{address}: ")


@pytest.mark.parametrize(
    ("answers", "status"),
    [
        (
            [packed("targets", {"targets": np.zeros((3, 7))})],
            "answer: 'targets' in answer to 'reset'",
        ),
        ([packed("ready"), packed("targets")], "answer: 'targets' in answer to 'act'"),
        ([packed("ready"), b"garbage, and more"], "answer: an answer begins with b'garb'"),
        ([packed("ready", failures="none")], "answer: its failures are no list of strings"),
        ([packed("ready", failures=[1])], "answer: its failures are no list of strings"),
        ([packed("ready"), None], "disconnected: the other side closed"),
        ([packed("ready"), b"DRP1"], "timeout: act took longer than 0.4 s"),
    ],
)
def test_garbage_in_the_middle_of_a_run_fails_the_batch(answers, status):
    remote = Remote(scripted(hello(), *answers), LIMIT)
    with pytest.raises(Failed) as failed:
        # A short observation, so that the script gets it in one piece.
        small = HostObservation(**{name: np.zeros((1, 1)) for name in OBSERVED})
        remote.reset(small)
        remote.act(small)
    assert str(failed.value).startswith(status)


def test_why_it_gives_up_an_episode_is_told():
    small = HostObservation(**{name: np.zeros((1, 1)) for name in OBSERVED})
    remote = Remote(scripted(hello(), packed("ready", failures=["no\npath " + 300 * "x"])), LIMIT)
    remote.reset(small)
    (said,) = remote.failures
    assert said.startswith("no path x") and len(said) == 200


def test_one_that_goes_away_for_good_ends_the_run(example):
    listener = socket.create_server(("127.0.0.1", 0))
    port = listener.getsockname()[1]

    def once():
        connection, _ = listener.accept()
        listener.close()
        connection.recv(1 << 20)
        connection.sendall(hello())
        connection.recv(1)
        connection.close()

    in_background(once)
    remote = Remote(f"127.0.0.1:{port}", LIMIT)
    with pytest.raises(Failed, match="disconnected"):
        remote.reset(observation())
    with pytest.raises(PolicyError, match="nobody answers there"):
        remote.reset(observation())


@pytest.mark.parametrize(
    "name", ["remote:nowhere", "remote:", "remote:host:port", "remote::1:99999"]
)
def test_an_address_is_a_host_and_a_port_or_a_path(name):
    with pytest.raises(PolicyError, match="remote:HOST:PORT"):
        choose(name)


def test_nobody_there_is_one_line(tmp_path):
    for name in (f"remote:127.0.0.1:{free_port()}", f"remote:{tmp_path}/none.sock"):
        with pytest.raises(PolicyError, match="nobody answers there .*start the policy first"):
            choose(name)
    with pytest.raises(PolicyError, match="takes its parameters where it runs"):
        choose("remote:127.0.0.1:1", ["gain=1"])


def test_the_example_needs_python_3_8_and_numpy_alone():
    tree = ast.parse(EXAMPLE.read_text(), feature_version=(3, 8))
    imported = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            imported |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            imported.add(node.module)
    assert "numpy" in imported and imported - {"numpy"} <= sys.stdlib_module_names
