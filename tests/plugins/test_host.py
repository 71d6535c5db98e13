"""Host policies: what they are handed, and what becomes of an answer, a failure, or none."""

import socket
import subprocess
import sys
import threading
import time
from dataclasses import fields
from pathlib import Path
from types import SimpleNamespace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from drpbench.contract import Episode
from drpbench.envs import TASKS, World
from drpbench.evaluation.metrics import rows
from drpbench.plugins.errors import PolicyError
from drpbench.plugins.host import Failed, Hosted, answered
from drpbench.plugins.registry import choose
from drpbench.policies import DcpRmp, Straight
from drpbench.problems import load_set
from drpbench.robot import PANDA
from drpbench.rollout import Rollout
from drpbench.rollout.batch import begin
from drpbench.rollout.host import apply, show

pytestmark = pytest.mark.slow


def hosted(policy, build, **settings):
    """Under DCP-RMP, so that one compiled world serves all tests."""
    return Hosted(policy, build, over=DcpRmp, **settings)


LANES, IDS = 4, [100, 0, 7]
STEPS = 340  # the boxes of FDO are gone 300 control steps before the end
WORLD = World(TASKS["FDO"], episode=Episode(STEPS))


class Blind:
    """The straight line, as `straight` goes it."""

    def reset(self, observation):
        self.seen = [observation]

    def act(self, observation):
        self.seen.append(observation)
        away = observation.goal_joints - observation.joint_position
        needed = np.max(np.abs(away) / PANDA.velocity_limit, axis=1, keepdims=True)
        share = np.minimum(1.0, 0.5 * 0.05 / np.maximum(needed, 1e-9))
        return observation.joint_position + share * away


class At(Blind):
    """As Blind until `step` of every batch, when it does `what`."""

    def __init__(self, step, what):
        self.step, self.what = step, what

    def act(self, observation):
        answer = super().act(observation)
        return self.what(answer) if len(self.seen) == self.step + 2 else answer


@pytest.fixture(scope="module")
def play():
    """Runs a host policy on problems; it is compiled once for all of them."""

    def run(policy, ids=IDS):
        problems = load_set().task("FDO")
        trace = Rollout(WORLD, policy, lanes=LANES).run(problems.take(ids))
        return trace, rows(ids, [problems.family[id] for id in ids], trace)

    return run


@pytest.fixture(scope="module")
def sound(play):
    """The trace and rows of Blind, and what it saw."""
    policy = Blind()
    return *play(hosted(policy, Blind)), policy.seen


def test_a_host_policy_sees_the_real_instances_at_every_step(sound):
    trace, found, seen = sound
    assert {row.status for row in found} == {"ok"} and not any(trace.failures)
    assert len(seen) == STEPS + 1
    shapes = {
        "joint_position": (7,),
        "joint_velocity": (7,),
        "goal_joints": (7,),
        "goal_position": (3,),
        "goal_quaternion": (4,),
        "scene_points": (2048, 3),
        "scene_mask": (2048,),
        "robot_points": (256, 3),
    }
    assert vars(seen[0]).keys() == {*shapes, "obstacles"}
    for observation in (seen[0], seen[1], seen[-1]):
        for name, shape in shapes.items():
            array = getattr(observation, name)
            assert type(array) is np.ndarray and array.flags.writeable
            assert array.shape == (3, *shape)
            assert array.dtype == (bool if name == "scene_mask" else np.float32)
        assert observation.obstacles is None
    problems = load_set().task("FDO")
    np.testing.assert_array_equal(seen[0].joint_position, problems.start[IDS])
    np.testing.assert_array_equal(seen[0].goal_joints, problems.goal[IDS])
    for step in (1, 17, STEPS - 1):
        np.testing.assert_array_equal(seen[step + 1].joint_position, trace.joint_position[step - 1])


def test_host_and_jax_policies_go_the_same_way_under_dcp_rmp(sound):
    trace, _, seen = sound
    jitted = Rollout(WORLD, DcpRmp(Straight()), lanes=LANES).run(load_set().task("FDO").take(IDS))
    for name in ("joint_position", "grip_position", "clearance", "mover_position"):
        # Later on DCP-RMP turns to another sphere a step sooner or later, and rounding is
        # amplified.
        np.testing.assert_allclose(
            getattr(trace, name)[:25], getattr(jitted, name)[:25], atol=1e-5, err_msg=name
        )
    # By then DCP-RMP has shown another goal, to the one arm that a box comes close to.
    away = np.abs(seen[25].goal_joints - load_set().task("FDO").goal[IDS]).max(axis=1)
    assert away[1] > 0.1 and (away[[0, 2]] == 0.0).all()


def test_what_is_handed_out_is_not_the_worlds_memory(play, sound):
    """A policy that scribbles over everything it gets changes nothing but its own copy."""

    class Scribbles(Blind):
        def act(self, observation):
            answer = super().act(observation)
            for array in vars(observation).values():
                if array is not None:
                    array[:] = 0
            return answer

    trace, found = play(hosted(Scribbles(), Scribbles))
    assert found == sound[1]
    np.testing.assert_array_equal(trace.joint_position, sound[0].joint_position)
    # PyTorch writes on JAX's own memory: none of it may belong to the world, or be there twice.
    batch = jax.tree.map(jnp.asarray, load_set().task("FDO").take([0, 1, 2, 3]))
    inside = hosted(Blind(), Blind).shown
    state, carry, _ = begin(WORLD, inside, 0, batch)
    for clock in range(2):
        seen, carry = show(WORLD, inside, 0, state, carry, np.int32(clock))
        owned = [
            leaf.unsafe_buffer_pointer()
            for leaf in jax.tree.leaves((state, carry))
            if not jnp.issubdtype(leaf.dtype, jax.dtypes.prng_key)
        ]
        shown = [leaf.unsafe_buffer_pointer() for leaf in jax.tree.leaves(seen)]
        assert len(set(shown)) == len(shown) and not set(shown) & set(owned)
        state, _ = apply(WORLD, state, np.zeros((LANES, 7), np.float32), np.int32(clock))


def broken(answer):
    raise ValueError("no\nsuch luck")


def leave(answer):
    raise SystemExit


@pytest.mark.parametrize(
    ("what", "status"),
    [
        (broken, "raised: ValueError: no such luck (test_host.py, line "),
        (leave, "raised: SystemExit"),
        (lambda answer: answer[:, :6], "shape: (3, 6), not (3, 7)"),
        (lambda answer: answer[0], "shape: (7,), not (3, 7)"),
        (lambda answer: None, "answer: NoneType of object, not numbers"),
        (lambda answer: "left", "answer: str of "),
        (lambda answer: (answer, answer[:2]), "answer: tuple is no array"),
        (lambda answer: time.sleep(1.5), "timeout: act took longer than 0.5 s"),
    ],
    ids=["raises", "exits", "six", "one", "none", "text", "ragged", "hangs"],
)
def test_a_failure_costs_its_batch_and_no_other(play, sound, what, status):
    made = []

    def build():
        made.append(Blind())
        return made[-1]

    policy = hosted(At(10, what), build, time_limit=0.5)
    trace, found = play(policy)
    assert all(row.status.startswith(status) and "\n" not in row.status for row in found)
    assert not any(row.success or row.reached for row in found)
    # until then it is the same to the bit, and from there on the arm rests
    np.testing.assert_array_equal(trace.joint_position[:10], sound[0].joint_position[:10])
    assert trace.finite[:10].all() and not trace.finite[10:].any()
    assert np.abs(trace.joint_velocity[-1]).max() < 0.05 < np.abs(trace.joint_velocity[9]).max()
    assert len(made) == 0
    if policy.policy is not None:
        policy.policy.what = lambda answer: answer
    assert play(policy)[1] == sound[1]
    assert len(made) == status.startswith("timeout")  # one that hung is never asked again


def test_a_reset_that_fails_costs_the_batch(play):
    class Unready(Blind):
        def reset(self, observation):
            raise RuntimeError("not today")

    trace, found = play(hosted(Unready(), Unready))
    assert {row.status.partition(" (")[0] for row in found} == {"raised: RuntimeError: not today"}
    assert not trace.finite.any()


@pytest.mark.parametrize("value", [np.nan, np.inf, 1e300])
def test_what_is_no_number_fails_its_own_instance_only(play, sound, value):
    def poison(answer):
        answer = answer.astype(float)
        answer[1, 3] = value
        return answer

    trace, found = play(hosted(At(10, poison), Blind))
    assert [row.status for row in found] == ["ok", "nan", "ok"]
    assert found[0] == sound[1][0] and found[2] == sound[1][2]
    assert np.nonzero(~trace.finite[:, 1])[0].tolist() == [10]


def test_a_policy_that_hung_and_cannot_be_made_anew_ends_the_run(play):
    def build():
        raise PolicyError("gone")

    policy = hosted(At(0, lambda answer: time.sleep(1.0)), build, time_limit=0.2)
    assert play(policy)[1][0].status.startswith("timeout")
    with pytest.raises(PolicyError, match="gone"):
        play(policy)


def test_threads_end_with_their_policies(play):
    before = threading.active_count()
    policy = hosted(Blind(), Blind)
    play(policy)
    assert threading.active_count() == before + 1
    del policy
    play(hosted(Blind(), Blind))
    deadline = time.monotonic() + 5.0
    while threading.active_count() > before + 1 and time.monotonic() < deadline:
        time.sleep(0.01)
    assert threading.active_count() <= before + 1


@pytest.mark.parametrize(
    "answer", [[[0.5] * 7, [1] * 7], np.full((2, 7), 2, np.int8), jnp.zeros((2, 7))]
)
def test_answers_may_be_any_array_of_numbers(answer):
    found = answered(answer, 2, 7)
    assert found.dtype == np.float32 and found.shape == (2, 7)
    np.testing.assert_array_equal(found, np.asarray(answer))


def test_complex_answers_are_refused():
    with pytest.raises(Failed, match="complex"):
        answered(np.zeros((2, 7), complex), 2, 7)


def test_the_examples_go_the_same_way_in_this_process_and_in_another(play, monkeypatch):
    root = Path(__file__).parents[2]
    monkeypatch.chdir(root)
    monkeypatch.setattr(sys, "path", list(sys.path))
    command = [sys.executable, "examples/remote_policy.py", "127.0.0.1:0"]
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        command[-1] = f"127.0.0.1:{probe.getsockname()[1]}"
    server = subprocess.Popen(command, stdout=subprocess.PIPE)
    try:
        server.stdout.readline()
        remote = choose(f"remote:{command[-1]}+dcp-rmp")
        trace, found = play(remote.policy)
    finally:
        server.kill()
        server.communicate()
    here = choose("examples.numpy_policy:Approach+dcp-rmp")
    assert play(here.policy)[1] == found and not any(trace.failures)
    assert here.parameters["policy.gain"] == 0.1 and here.parameters["host.arrays"] == "numpy"
    assert remote.parameters == here.parameters | {"policy.remote": "approach"}


def test_unknown_arrays_list_those_there_are():
    with pytest.raises(PolicyError, match="'cupy'; there are: numpy, torch, jax"):
        hosted(SimpleNamespace(arrays="cupy"), Blind)


def test_jax_arrays_stay_on_the_device(play, sound):
    class Jax(Blind):
        arrays = "jax"

    policy = Jax()
    _, found = play(hosted(policy, Jax))
    assert isinstance(policy.seen[-1].scene_points, jax.Array)
    assert [row.status for row in found] == ["ok"] * 3
    np.testing.assert_array_equal(policy.seen[0].scene_points, sound[2][0].scene_points)


def test_a_policy_for_pytorch_says_how_to_get_it(monkeypatch):
    monkeypatch.setitem(sys.modules, "torch", None)
    with pytest.raises(PolicyError, match=r'pip install "drpbench\[torch\]"'):
        hosted(SimpleNamespace(arrays="torch"), Blind)


def test_dlpack_hands_out_jaxs_own_memory(monkeypatch):
    """NumPy stands in for PyTorch: both read DLPack, and what is checked is that nothing is copied,
    but for the mask (not every PyTorch reads booleans)."""
    from contextlib import nullcontext

    from drpbench.contract import observation_spec
    from drpbench.plugins.host import HANDED
    from drpbench.plugins.imported import nothing_seen

    stand_in = SimpleNamespace(
        from_dlpack=np.from_dlpack,
        no_grad=nullcontext,
        bool=np.bool_,
        cuda=SimpleNamespace(is_available=lambda: False),
    )
    monkeypatch.setitem(sys.modules, "torch", stand_in)
    batch = jax.tree.map(lambda leaf: jnp.stack([leaf] * 4), nothing_seen(observation_spec()))
    handed, context = HANDED["torch"](batch, 3, SimpleNamespace())
    for of in fields(batch):
        if (leaf := getattr(batch, of.name)) is not None:
            array = getattr(handed, of.name)
            assert array.shape == (3, *leaf.shape[1:]) and array.dtype == leaf.dtype
            shared = array.ctypes.data == leaf.unsafe_buffer_pointer()
            assert shared == (of.name != "scene_mask")
    assert context is nullcontext


class Tensor:
    """What `answered` knows of a tensor."""

    def __init__(self, values, dtype="torch.float32", fails=""):
        self.values, self.dtype, self.fails = np.asarray(values), dtype, fails

    def detach(self):
        if self.fails:
            raise RuntimeError(self.fails)
        return self

    def cpu(self):
        return self

    def float(self):
        return self.values.astype(np.float32)


def test_a_tensor_costs_its_batch_and_never_the_run():
    np.testing.assert_array_equal(answered(Tensor(np.ones((2, 7))), 2, 7), np.ones((2, 7)))
    for answer, told in (
        (Tensor(np.ones((2, 7)), fails="a sparse tensor"), "a sparse tensor"),
        (Tensor(np.ones((2, 7)), "torch.bool"), "torch.bool, not numbers"),
        (Tensor(np.ones((2, 7)), "torch.complex64"), "not numbers"),
        (np.ones((2, 7), bool), "not numbers"),
        (Tensor(np.ones((2, 6))), r"shape: \(2, 6\)"),
        (None, "not numbers"),
        ("left", "not numbers"),
    ):
        with pytest.raises(Failed, match=told):
            answered(answer, 2, 7)


class GivesUp(Blind):
    """Says of its episodes why it gives them up."""

    reasons: tuple[str, ...] = ()

    def reset(self, observation):
        super().reset(observation)
        self.failures = self.reasons


def test_reasons_to_give_up_cost_their_own_instances(play):
    policy = GivesUp()
    policy.reasons = ("planner: found no path", *[""] * (len(IDS) - 1))
    _, found = play(hosted(policy, GivesUp))
    assert [row.status for row in found] == ["planner: found no path", *["ok"] * (len(IDS) - 1)]
    assert not found[0].reached and not found[0].success


def test_reasons_of_another_number_cost_the_batch(play):
    policy = GivesUp()
    policy.reasons = ("no",) * (len(IDS) + 1)
    _, found = play(hosted(policy, GivesUp))
    said = f"failures: {len(IDS) + 1} of them for {len(IDS)} episodes"
    assert {row.status for row in found} == {said}
