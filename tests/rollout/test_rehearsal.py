"""SAO's two passes: the first records the policy's path, in the second a box stands on it."""

import numpy as np
import pytest

from drpbench.contract import CONTROL_STEPS
from drpbench.envs import TASKS
from drpbench.policies import Straight
from drpbench.problems import load_set
from drpbench.rollout import Rollout

IDS = [0, 1, 2, 100, 101, 102, 200, 201]


@pytest.fixture(scope="module")
def passes():
    """Both passes of the blind straight line on eight problems, and what was told of the progress."""
    rollout, told, episodes = Rollout(TASKS["SAO"], Straight(), lanes=8), [], []
    whole = rollout._episode

    def spied(*arguments):
        episodes.append(whole(*arguments))
        return dict(episodes[-1])

    rollout._episode = spied
    trace = rollout.run(load_set().task("SAO").take(IDS), told.append)
    assert len(episodes) == 2
    return episodes[0], trace, told


def test_progress_counts_both_passes(passes):
    assert sum(passes[2]) == 2 * CONTROL_STEPS


def test_the_first_pass_has_no_box(passes):
    assert not passes[0]["mover_active"].any()


def test_the_box_stands_on_the_recorded_path_ahead_of_the_arm(passes):
    first, trace, _ = passes
    appeared = trace.mover_active[30, :, 0]
    assert appeared.sum() >= 4
    assert not trace.mover_active[:30].any() and not trace.mover_active[900:].any()
    for b in np.nonzero(appeared)[0]:
        later = first["grip_position"][35::5, b]
        assert (later == trace.mover_position[30, b, 0]).all(axis=1).any()


def test_the_blind_policy_goes_the_same_way_and_hits_the_box(passes):
    first, trace, _ = passes
    free = (first["clearance"] > 0.0).all(axis=0)
    lanes = np.nonzero(free & trace.mover_active[30, :, 0])[0]
    assert lanes.size >= 2
    for b in lanes:
        touching = trace.clearance[:, b] < 0.0
        until = touching.argmax()
        assert touching.any() and until > 30
        np.testing.assert_array_equal(
            trace.joint_position[:until, b], first["joint_position"][:until, b]
        )
