"""SAO: nothing in the first pass; in the second, a box on the path that the first recorded."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from drpbench.compile import jit
from drpbench.contract import EPISODE
from drpbench.envs import TASKS
from drpbench.envs.movers import clearance_of_box

from .conftest import COUNT

DUE = (30, 230, 430, 630, 830)
STRIDE = 5


@pytest.fixture(scope="module")
def second():
    """The second pass of arms that stay where they are, on recorded paths (B, 1000, 3): the
    boxes."""
    task = TASKS["SAO"]

    def run(problem, arm, path, key):
        movers, memory = task.reset(problem, arm, key, EPISODE)
        carry = movers, task.second_pass(memory, path)

        def step(carry, clock):
            carry = task.advance(*carry, problem, arm, clock, EPISODE)
            return carry, carry[0]

        return jax.lax.scan(step, carry, jnp.arange(EPISODE.steps))[1]

    return jit(jax.vmap(run))


@pytest.fixture(scope="module")
def paths(crowd):
    """Paths that leave grip in a straight line for 0.9 m; the last 20 stay where they are."""
    rng = np.random.default_rng(0)
    direction = rng.normal(size=(COUNT, 1, 3))
    direction /= np.linalg.norm(direction, axis=-1, keepdims=True)
    direction[-20:] = 0.0
    along = np.linspace(0.0, 0.9, EPISODE.steps)[:, None]
    return (np.asarray(crowd[1].grip_position)[:, None] + along * direction).astype(np.float32)


@pytest.fixture(scope="module")
def boxes(second, crowd, paths):
    problems, arms = crowd
    return second(problems, arms, paths, jax.random.split(jax.random.key(0), COUNT))


@pytest.fixture(scope="module")
def path_rooms():
    """Distance [m] (B, 200) to the arm of a box (half sizes (B, 3), rotations) at every fifth
    pose."""

    def rooms(half_size, rotation, places, arm):
        return jax.vmap(
            lambda place: clearance_of_box(half_size, rotation, place, arm.centers, arm.radii)
        )(places)

    return jit(jax.vmap(rooms))


def test_the_first_pass_has_no_box(lives):
    _, _, (_, _, active), valid = lives("SAO")
    assert not np.asarray(active).any()
    assert np.asarray(valid).all()


def test_the_box_is_on_the_first_later_pose_with_room(boxes, crowd, paths, path_rooms):
    problems, arms = crowd
    half_size = np.asarray(boxes.half_size)[:, :, 0]
    rotation = np.asarray(boxes.rotation)[:, :, 0]
    position = np.asarray(boxes.position)[:, :, 0]
    limit = np.where(problems.level == 1, 0.2, 0.1)[:, None]
    moves = 0
    for due in DUE:
        drawn = (half_size[:, due] != half_size[:, due - 1]).any(axis=1)
        poses = paths[:, ::STRIDE]
        room = np.asarray(path_rooms(half_size[:, due], rotation[:, due], poses, arms))
        fits = (np.arange(len(poses[0])) * STRIDE > due) & (room > limit)
        assert fits[drawn].any(axis=1).all()
        first = fits.argmax(axis=1)
        expected = poses[np.arange(COUNT), first]
        np.testing.assert_array_equal(position[drawn, due], expected[drawn])
        np.testing.assert_array_equal(position[~drawn, due], position[~drawn, due - 1])
        moves += drawn.sum()
    assert moves > 200


def test_the_box_changes_only_when_it_is_due(boxes):
    position = np.asarray(boxes.position)[:, :, 0]
    changed = (position[:, 1:] != position[:, :-1]).any(axis=(0, 2))
    assert set(np.nonzero(changed)[0] + 1) <= set(DUE)
    active = np.asarray(boxes.active)[..., 0]
    assert not active[:, : DUE[0]].any()
    assert active[:, DUE[0]].any()


def test_edges_are_as_long_as_the_level_says(boxes):
    half = np.asarray(boxes.half_size)[:, 600, 0]
    there = np.asarray(boxes.active)[:, 600, 0]
    for level, shortest, longest in ((1, 0.025, 0.15), (2, 0.05, 0.1)):
        here = half[level - 1 :: 2][there[level - 1 :: 2]]
        assert shortest <= here.min() < 1.2 * shortest
        assert 0.95 * longest < here.max() <= longest


def test_without_a_pose_with_room_no_box_appears(boxes):
    assert not np.asarray(boxes.active)[-20:].any()


def test_the_box_is_gone_100_steps_before_the_end(boxes):
    active = np.asarray(boxes.active)[..., 0]
    assert active[:, 899].any()
    assert not active[:, 900:].any()
