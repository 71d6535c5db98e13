"""GB: when and how a box is put on the goal."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from drpbench.compile import jit
from drpbench.contract import EPISODE
from drpbench.envs import TASKS

from .conftest import COUNT, arms_at

ARRIVES = 40  # control step at which the arms come near their goals


@pytest.fixture(scope="module")
def episode():
    """One arm that is `far` before a control step and `near` from it on: boxes, tries and valid."""
    task = TASKS["GB"]

    def run(problem, far, near, arrives, key):
        def step(carry, clock):
            arm = jax.tree.map(lambda a, b: jnp.where(clock < arrives, a, b), far, near)
            movers, memory = task.advance(*carry, problem, arm, clock, EPISODE)
            return (movers, memory), (movers, memory.tries)

        (_, memory), (steps, tries) = jax.lax.scan(
            step, task.reset(problem, far, key, EPISODE), jnp.arange(EPISODE.steps)
        )
        return steps, tries, task.valid(memory)

    return jit(jax.vmap(run, in_axes=(0, 0, 0, None, 0)))


@pytest.fixture(scope="module")
def blocked(episode, crowd):
    """Problems whose goals lie 0.3 to 0.45 m (and for the last 50 0.6 m) beside the near arm's
    grip."""
    problems, near = crowd
    far = arms_at(np.roll(np.asarray(problems.start), 1, axis=0))
    rng = np.random.default_rng(0)
    direction = rng.normal(size=(COUNT, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    away = np.where(np.arange(COUNT) < COUNT - 50, rng.uniform(0.3, 0.45, COUNT), 0.6)
    goal = np.asarray(near.grip_position) + away[:, None] * direction
    # The far arm must not be near by accident.
    apart = np.linalg.norm(np.asarray(far.grip_position) - goal, axis=1) > 0.5
    problems = replace(problems, goal_position=goal.astype(np.float32))
    keys = jax.random.split(jax.random.key(0), COUNT)
    movers, tries, valid = episode(problems, far, near, ARRIVES, keys)
    return problems, near, apart, away < 0.5, movers, np.asarray(tries), np.asarray(valid)


def test_nothing_is_there_until_the_arm_is_near(blocked):
    *_, apart, near, movers, tries, _ = blocked
    active = np.asarray(movers.active)[..., 0]
    assert not active[apart, :ARRIVES].any()
    assert (tries[apart, ARRIVES - 1] == 0).all()


def test_the_box_stands_on_the_goal_clear_of_the_arm(blocked, rooms):
    problems, arms, apart, near, movers, _, _ = blocked
    placed = np.asarray(movers.active)[..., 0].any(axis=1) & apart
    assert placed.sum() > 50
    assert (placed <= near).all()
    last = jax.tree.map(lambda leaf: leaf[:, 750], movers)
    assert np.asarray(last.active)[placed].all()
    np.testing.assert_array_equal(
        np.asarray(last.position)[placed, 0], problems.goal_position[placed]
    )
    assert rooms(last, arms)[placed].min() > 0.01
    half = np.asarray(last.half_size)[placed]
    assert 0.1 <= half.min() < 0.11 and 0.19 < half.max() <= 0.2


def test_the_box_stays_until_200_steps_before_the_end(blocked):
    *_, movers, _, _ = blocked
    active = np.asarray(movers.active)[..., 0]
    placed = active.any(axis=1)
    for b in np.nonzero(placed)[0]:
        first = active[b].argmax()
        assert active[b, first:800].all()
    assert not active[:, 800:].any()
    position = np.asarray(movers.position)
    np.testing.assert_array_equal(position[placed, 799], position[placed, 999])


def test_one_draw_a_step_and_a_hundred_at_most(blocked):
    _, _, apart, near, movers, tries, valid = blocked
    active = np.asarray(movers.active)[..., 0]
    for b in np.nonzero(apart & near)[0]:
        first = active[b].argmax() if valid[b] else ARRIVES + 99
        assert tries[b, first] == first - ARRIVES + 1
        assert tries[b, -1] == tries[b, first] <= 100
    assert (tries[apart & near & valid, -1] > 1).any()


def test_an_episode_without_a_box_is_valid_only_where_the_arm_stayed_away(blocked):
    *_, apart, near, movers, _, valid = blocked
    there = np.asarray(movers.active)[..., 0].any(axis=1)
    assert valid[there].all()
    assert (~there & near).any() and not valid[~there & near].any()
    assert (apart & ~near).any() and valid[apart & ~near].all()


def test_nothing_is_placed_after_the_removal(episode, crowd):
    problems, arms = crowd
    far = jax.tree.map(lambda leaf: leaf + 5.0, arms)
    keys = jax.random.split(jax.random.key(1), COUNT)
    beside = replace(problems, goal_position=problems.goal_position + np.float32(0.25))
    movers, tries, valid = episode(beside, far, arms, 800, keys)
    assert not np.asarray(movers.active).any() and not np.asarray(tries).any()
    assert np.asarray(valid).all()  # the arm was not near in time
