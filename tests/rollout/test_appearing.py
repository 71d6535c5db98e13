"""SAO from end to end: every arm of a problem meets a box on the same way."""

import numpy as np
import pytest

from drpbench.envs import TASKS, World
from drpbench.policies import Straight
from drpbench.problems import load_set
from drpbench.robot import PANDA
from drpbench.rollout import Rollout

pytestmark = pytest.mark.slow

IDS = [0, 1, 2, 100, 101, 102, 200, 201]


@pytest.fixture(scope="module")
def traces():
    """The blind straight line and standing still on eight problems."""
    problems, told = load_set().task("SAO").take(IDS), []
    world = World(TASKS["SAO"])
    # At no speed the straight line stands still, in the same program.
    rollouts = [Rollout(world, policy, lanes=len(IDS)) for policy in (Straight(), Straight(0.0))]
    return problems, [rollout.run(problems, told.append) for rollout in rollouts], told


def test_every_episode_has_a_box(traces):
    _, both, told = traces
    for trace in both:
        assert trace.mover_active[30:900].all() and trace.valid.all()
        assert not trace.mover_active[:30].any() and not trace.mover_active[900:].any()
    assert sum(told) == 2 * TASKS["SAO"].movers * len(both[0].clearance)


def test_the_box_stands_on_the_witness(traces):
    problems, both, _ = traces
    for trace in both:
        for b in range(len(IDS)):
            way = [PANDA.grip_pose(PANDA.link_poses(q))[0] for q in problems.witness[b]]
            away = np.linalg.norm(np.asarray(way) - trace.mover_position[30, b, 0], axis=1)
            assert away.min() < 1e-5


def test_who_stands_still_gains_nothing_and_who_goes_straight_is_hit(traces):
    _, (straight, hold), _ = traces
    assert not (straight.verdict.success | hold.verdict.success).any()
    # Sizes and turns are the same for both, whatever they do.
    np.testing.assert_array_equal(straight.mover_half_size[30], hold.mover_half_size[30])
    np.testing.assert_array_equal(straight.mover_rotation[30], hold.mover_rotation[30])
    assert straight.verdict.collided.sum() >= 6
