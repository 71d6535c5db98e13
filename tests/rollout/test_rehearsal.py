"""SAO's two passes: the first records the policy's path, in the second a box stands on it."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from drpbench.contract import EPISODE
from drpbench.envs import TASKS, State, World
from drpbench.policies import Straight
from drpbench.problems import load_set
from drpbench.rollout import Rollout
from drpbench.rollout.batch import begin, device_pass, silent
from drpbench.rollout.rehearsal import Rehearsal, second_pass

pytestmark = pytest.mark.slow

IDS = [0, 1, 2, 100, 101, 102, 200, 201]


@pytest.fixture(scope="module")
def passes():
    """Both passes of the blind straight line on eight problems, and what
    was told of the progress."""
    world, policy, told = World(TASKS["SAO"]), Straight(), []
    problems = load_set().task("SAO").take(IDS)
    trace = Rollout(world, policy, lanes=len(IDS)).run(problems, told.append)
    state, carry, _ = begin(world, policy, 0, jax.tree.map(jnp.asarray, problems))
    first, _ = device_pass(world, policy, 0, state, carry, silent)
    return first, trace, told


def test_progress_counts_both_passes(passes):
    assert sum(passes[2]) == 2 * EPISODE.steps


def test_the_first_pass_has_no_box(passes):
    assert not passes[0].mover_active.any()


def test_the_box_stands_on_the_recorded_path_ahead_of_the_arm(passes):
    first, trace, _ = passes
    appeared = trace.mover_active[30, :, 0]
    assert appeared.sum() >= 4
    assert not trace.mover_active[:30].any() and not trace.mover_active[900:].any()
    for b in np.nonzero(appeared)[0]:
        later = first.grip_position[35::5, b]
        assert (later == trace.mover_position[30, b, 0]).all(axis=1).any()


def test_the_blind_policy_goes_the_same_way_and_hits_the_box(passes):
    first, trace, _ = passes
    free = (first.clearance > 0.0).all(axis=0)
    lanes = np.nonzero(free & trace.mover_active[30, :, 0])[0]
    assert lanes.size >= 2
    for b in lanes:
        touching = trace.clearance[:, b] < 0.0
        until = touching.argmax()
        assert touching.any() and until > 30
        np.testing.assert_array_equal(
            trace.joint_position[:until, b], first.joint_position[:until, b]
        )


def test_an_episode_that_is_stepped_rehearses_alike(passes):
    """`Rehearsal`, told step by step, makes of the path what `second_pass` makes of all of it."""
    first, world = passes[0], World(TASKS["SAO"])
    problems = jax.tree.map(jnp.asarray, load_set().task("SAO").take(IDS))
    state, _, _ = begin(world, Straight(), 0, problems)
    rehearsal = Rehearsal(world, state)
    for grip in first.grip_position[:7]:
        rehearsal.note(grip)
    rehearsal.restart()
    for grip in first.grip_position:
        rehearsal.note(grip)
    assert rehearsal.on
    begun = rehearsal.end()
    assert not rehearsal.on and rehearsal.first is begun
    rehearsal.note(first.grip_position[0])
    rehearsal.restart()
    assert rehearsal.first is begun  # it stays known
    expected = second_pass(world, state, first.grip_position)
    np.testing.assert_array_equal(begun.memory.path, expected.memory.path)
    assert begun.memory.known.all() and not state.memory.known.any()


def test_a_task_without_a_rehearsal_is_never_on():
    state = object.__new__(State)
    assert not Rehearsal(World(TASKS["SE"]), state).on
