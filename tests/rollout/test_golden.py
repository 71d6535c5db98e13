"""Episodes are what they were, to the bit, on a processor whose golden traces are known.

`golden.py` has the other tasks' traces, and compares them with a run's trajectories.
"""

import numpy as np
import pytest

from drpbench.evaluation.run import world_of
from drpbench.plugins.registry import choose
from drpbench.problems import load_set
from drpbench.rollout import Rollout

from .golden import PROBLEMS, digest, golden, processor

pytestmark = pytest.mark.slow

TASK = "SE"


@pytest.mark.parametrize("policy", ["rmp", "drp"])
def test_episodes_are_the_golden_ones(policy):
    known = golden().get(f"{policy} {TASK}")
    if known is None:
        pytest.skip(f"no golden traces of {processor()}")
    problem_set = load_set()
    problems = problem_set.task(TASK).take(range(PROBLEMS))
    trace = Rollout(world_of(problem_set, TASK), choose(policy).policy).run(problems)
    positions = np.concatenate([trace.start[None], trace.joint_position])
    assert [digest(positions[:, id]) for id in range(PROBLEMS)] == known


def test_a_trace_that_differs_in_one_bit_is_noticed():
    positions = np.linspace(0.0, 1.0, 14, dtype=np.float32).reshape(2, 7)
    other = positions.copy()
    other[1, 3] = np.nextafter(other[1, 3], np.float32(2.0))
    assert digest(positions) == digest(positions.copy()) != digest(other)
