"""The verdict: step by step or at once, in NumPy or in JAX, it is one and the same."""

import math
from dataclasses import dataclass, fields

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from drpbench.contract import REACH_POSITION_LOOSE, Verdict, reached

STEPS, SHAPE = 12, (5, 4)


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Steps:
    position_error: np.ndarray
    orientation_error: np.ndarray
    clearance: np.ndarray
    finite: np.ndarray


def drawn():
    """Episodes of all kinds: (STEPS, *SHAPE) arrays, and whether each is valid."""
    rng = np.random.default_rng(0)
    shape = (STEPS, *SHAPE)
    steps = Steps(
        position_error=rng.uniform(0.0, 0.02, shape).astype(np.float32),
        orientation_error=rng.uniform(0.0, 0.4, shape).astype(np.float32),
        clearance=rng.uniform(-0.01, 0.1, shape).astype(np.float32),
        finite=rng.random(shape) > 0.03,
    )
    return steps, rng.random(SHAPE) > 0.5


def by_hand(steps, valid, index):
    """One episode's verdict, in plain Python."""
    errors = zip(steps.position_error, steps.orientation_error, strict=True)
    at_goal = [p[index] < 0.01 and o[index] < math.radians(15.0) for p, o in errors]
    touches = [k for k in range(STEPS) if steps.clearance[k][index] < 0.0]
    finite = all(step[index] for step in steps.finite)
    was_reached = at_goal[-1] and finite
    return {
        "reached": was_reached,
        "collided": bool(touches),
        "success": was_reached and not touches,
        "first_collision_step": touches[0] if touches else -1,
        "finite": finite,
        "valid": bool(valid[index]),
    }


def assert_right(verdict, steps, valid):
    for index in np.ndindex(*SHAPE):
        for name, expected in by_hand(steps, valid, index).items():
            assert np.asarray(getattr(verdict, name))[index] == expected, name


def test_whole_episodes_are_judged_right():
    steps, valid = drawn()
    verdict = Verdict.of(steps, valid)
    assert_right(verdict, steps, valid)
    for name in ("reached", "collided", "success", "finite"):
        assert 0 < getattr(verdict, name).sum() < math.prod(SHAPE), name
    on_device = Verdict.of(jax.tree.map(jnp.asarray, steps), jnp.asarray(valid))
    assert_right(on_device, steps, valid)
    assert isinstance(on_device.reached, jax.Array) and isinstance(verdict.reached, np.ndarray)


@pytest.mark.parametrize("kind", ["numpy", "jax"])
def test_step_by_step_it_comes_to_the_same(kind):
    steps, valid = drawn()
    after = jax.jit(Verdict.after) if kind == "jax" else Verdict.after
    verdict = Verdict.begin(SHAPE)
    assert not verdict.collided.any() and not verdict.success.any() and verdict.finite.all()
    for clock in range(STEPS):
        step = jax.tree.map(lambda leaf, clock=clock: leaf[clock], steps)
        verdict = after(verdict, step, valid, np.int32(clock))
        for of in fields(Verdict):
            begun = getattr(Verdict.begin(SHAPE), of.name)
            assert getattr(verdict, of.name).dtype == begun.dtype
    assert_right(verdict, steps, valid)


def test_a_single_episode_has_a_verdict_of_single_values():
    step = Steps(*map(np.float32, (0.001, 0.1, -0.002)), np.bool_(True))
    verdict = Verdict.begin().after(step, np.bool_(True), 3)
    assert verdict.reached and verdict.collided and not verdict.success
    assert verdict.first_collision_step == 3
    unfinished = verdict.after(
        Steps(*map(np.float32, (0.001, 0.1, 0.1)), np.bool_(False)), np.bool_(True), 4
    )
    assert not unfinished.reached and unfinished.first_collision_step == 3


@pytest.mark.parametrize(
    ("position", "degrees", "at_1cm", "at_5cm"),
    [(0.009, 14.9, True, True), (0.011, 14.9, False, True), (0.009, 15.1, False, False)],
)
def test_reached_is_within_a_length_and_15_degrees(position, degrees, at_1cm, at_5cm):
    errors = np.float32(position), np.float32(math.radians(degrees))
    assert bool(reached(*errors)) is at_1cm
    assert bool(reached(*errors, REACH_POSITION_LOOSE)) is at_5cm
    assert bool(reached(*map(jnp.asarray, errors))) is at_1cm
