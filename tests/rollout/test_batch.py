"""Episodes: the same whatever the batch and the order, and compiled once."""

import os
from dataclasses import dataclass, fields

import jax
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from drpbench.contract import Episode
from drpbench.envs import TASKS, World
from drpbench.evaluation.metrics import rows
from drpbench.policies import DcpRmp, Straight
from drpbench.problems import load_set
from drpbench.rollout import LANES, Rollout, Trace, instance_key

from ..scenes import bodies

pytestmark = pytest.mark.slow


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Tallied:
    """A policy that counts how often it is traced."""

    policy: DcpRmp

    privileged = False
    traces = []

    def init(self, observation):
        return self.policy.init(observation)

    def act(self, observation, carry, key):
        self.traces.append("act")
        return self.policy.act(observation, carry, key)


STEPS = 600  # long enough for boxes to reach the arms
GONE = 300  # control steps before the end, from where on there are no boxes


@pytest.fixture(scope="module")
def floating():
    """FDO under a policy that reacts, 64 lanes as in every run, cut short."""
    world = World(TASKS["FDO"], episode=Episode(STEPS))
    return Rollout(world, Tallied(DcpRmp(Straight())))


@pytest.fixture(scope="module")
def problems():
    return load_set().task("FDO")


@pytest.fixture(scope="module")
def of_64(floating, problems):
    """The trace of problems 0 to 63, and what was told of its progress."""
    told = []
    return floating.run(problems.take(range(64)), told.append), told


def verdicts(problems, ids, trace):
    return rows(list(ids), [problems.family[id] for id in ids], trace)


ARRAYS = [of.name for of in fields(Trace) if of.name not in ("world", "failures")]


def over_time(name):
    return name not in {"start", "start_grip", "valid"}


def test_64_problems_tell_good_from_bad(of_64, problems):
    found = verdicts(problems, range(64), of_64[0])
    assert {row.status for row in found} == {"ok"}
    assert 0 < sum(row.collided for row in found) < 64
    assert 0 < sum(row.success for row in found) < 64


@pytest.mark.skipif(
    jax.default_backend() == "cpu"
    and tuple(map(int, jax.__version__.split(".")[:2])) >= (0, 11)
    and "xla_cpu_max_isa" not in os.environ.get("XLA_FLAGS", ""),
    reason="from jax 0.11 on rounding depends on the lane without XLA_FLAGS=--xla_cpu_max_isa=AVX",
)
@pytest.mark.parametrize(
    "ids",
    [[3, 17, 60, 42, 5, 11, 29], np.random.default_rng(0).permutation(64).tolist()],
    ids=["7", "64 in another order"],
)
def test_episodes_are_the_same_to_the_bit_in_any_batch(floating, problems, of_64, ids):
    whole, traces = of_64[0], len(floating.policy.traces)
    part = floating.run(problems.take(ids))
    assert len(floating.policy.traces) == traces > 0  # nothing compiled again
    assert not any(part.failures + whole.failures)
    for name in ARRAYS:
        expected, found = getattr(whole, name), getattr(part, name)
        expected = expected[:, ids] if over_time(name) else expected[ids]
        np.testing.assert_array_equal(found, expected, err_msg=name)
    all_rows = verdicts(problems, range(64), whole)
    assert verdicts(problems, ids, part) == [all_rows[id] for id in ids]


def test_a_trace_holds_every_step_of_every_problem(of_64, problems):
    trace, told = of_64
    assert sum(told) == STEPS and len(told) > 1
    for name in ARRAYS:
        shape = getattr(trace, name).shape
        assert shape[:2] == (STEPS, 64) if over_time(name) else shape[0] == 64, name
    np.testing.assert_array_equal(trace.start, problems.start[:64])
    _, grip, quaternion, apart = bodies(trace.joint_position[-1])
    np.testing.assert_allclose(trace.grip_position[-1], grip, atol=1e-6)
    np.testing.assert_allclose(trace.self_clearance[-1], apart, atol=2e-6)
    np.testing.assert_allclose(trace.start_grip, bodies(trace.start)[1], atol=1e-6)
    off = np.linalg.norm(grip - problems.goal_position[:64], axis=1)
    np.testing.assert_allclose(trace.position_error[-1], off, atol=2e-6)
    xyzw = [1, 2, 3, 0]
    turn = Rotation.from_quat(quaternion[:, xyzw]).inv()
    turn *= Rotation.from_quat(problems.goal_quaternion[:64][:, xyzw])
    np.testing.assert_allclose(trace.orientation_error[-1], turn.magnitude(), atol=1e-3)
    assert trace.mover_active[: STEPS - GONE].all() and trace.valid.all() and trace.finite.all()


def test_a_batch_is_neither_empty_nor_larger_than_its_lanes(floating, problems):
    for ids in ([], range(LANES + 1)):
        with pytest.raises(ValueError, match=f"{len(ids)} problems for {LANES} lanes"):
            floating.run(problems.take(ids))


def test_an_instances_randomness_is_its_own():
    def bits(*which):
        return tuple(jax.random.key_data(instance_key(*which)).tolist())

    first = bits(0, "FDO", 5, 0)
    others = {
        bits(1, "FDO", 5, 0),
        bits(0, "DGB", 5, 0),
        bits(0, "FDO", 6, 0),
        bits(0, "FDO", 5, 1),
    }
    assert len(others | {first}) == 5
    batched = jax.vmap(lambda id: instance_key(0, "FDO", id, 0))(np.arange(9))
    assert tuple(jax.random.key_data(batched)[5].tolist()) == first


def test_taken_problems_are_those_of_the_set(problems):
    ids = [150, 3, 77]
    taken = problems.take(ids)
    np.testing.assert_array_equal(taken.id, ids)
    for name in ("level", "start", "goal", "goal_position", "goal_quaternion"):
        np.testing.assert_array_equal(getattr(taken, name), getattr(problems, name)[ids])
    for name in ("kind", "half_size", "position", "mask"):
        expected = getattr(problems.obstacles, name)[ids]
        np.testing.assert_array_equal(getattr(taken.obstacles, name), expected)
    quaternion = problems.obstacles.quaternion[ids].reshape(-1, 4)[:, [1, 2, 3, 0]]
    expected = Rotation.from_quat(quaternion).as_matrix().reshape(taken.obstacles.rotation.shape)
    np.testing.assert_allclose(taken.obstacles.rotation, expected, atol=1e-6)
