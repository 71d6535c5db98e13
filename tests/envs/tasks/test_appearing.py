"""SAO: a box on the way to the goal, ahead of the arm."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from drpbench.compile import jit
from drpbench.contract import EPISODE, WAY_POINTS
from drpbench.envs import TASKS
from drpbench.envs.movers import clearance_of_box
from drpbench.robot import PANDA

from ...scenes import bodies, postures
from .conftest import COUNT

DUE = (30, 230, 430, 630, 830)
STILL = 20  # the last of the crowd have no way to go


@pytest.fixture(scope="module")
def on_their_way(crowd):
    """The crowd's arms with goals elsewhere, and the way of each through joint space."""
    problems, arms = crowd
    start = np.asarray(problems.start)
    goal = postures(COUNT, seed=11)
    goal[-STILL:] = start[-STILL:]
    share = np.linspace(0.0, 1.0, WAY_POINTS, dtype=np.float32)[:, None]
    return replace(problems, goal=goal, witness=start[:, None] + share * (goal - start)[:, None])


@pytest.fixture(scope="module")
def paths(on_their_way):
    """Positions of grip [m] (B, W, 3) along the ways."""
    flat = np.asarray(on_their_way.witness).reshape(-1, 7)
    return bodies(flat)[1].reshape(COUNT, WAY_POINTS, 3)


@pytest.fixture(scope="module")
def episodes(crowd, on_their_way):
    """Boxes of every control step, arms staying where they are; whether the episodes are valid."""
    task = TASKS["SAO"]

    def run(problem, arm, key):
        def step(carry, clock):
            carry = task.advance(*carry, problem, arm, clock, EPISODE)
            return carry, carry[0]

        begun = task.reset(problem, arm, key, EPISODE)
        (_, memory), boxes = jax.lax.scan(step, begun, jnp.arange(EPISODE.steps))
        return boxes, task.valid(memory)

    keys = jax.random.split(jax.random.key(0), COUNT)
    return jit(jax.vmap(run))(on_their_way, crowd[1], keys)


@pytest.fixture(scope="module")
def way_rooms():
    """Distance [m] (B, W) to the arm of a box (half sizes (B, 3), rotations) at every place."""

    def rooms(half_size, rotation, places, arm):
        return jax.vmap(
            lambda place: clearance_of_box(half_size, rotation, place, arm.centers, arm.radii)
        )(places)

    return jit(jax.vmap(rooms))


def test_the_box_is_on_the_first_point_ahead_with_room_or_on_the_roomiest(
    episodes, crowd, on_their_way, paths, way_rooms
):
    boxes, _ = episodes
    arms = crowd[1]
    half_size = np.asarray(boxes.half_size)[:, :, 0]
    rotation = np.asarray(boxes.rotation)[:, :, 0]
    position = np.asarray(boxes.position)[:, :, 0]
    active = np.asarray(boxes.active)[:, :, 0]
    limit = np.where(on_their_way.level == 1, 0.2, 0.1)[:, None]
    first_places = instead = 0
    for due in DUE:
        drawn = active[:, due] & (half_size[:, due] != half_size[:, due - 1]).any(axis=1)
        room = np.array(way_rooms(half_size[:, due], rotation[:, due], paths, arms))
        room[:, 0] = -np.inf  # where the arm stands is not ahead of it
        fits = room > limit
        somewhere = fits.any(axis=1)
        where = np.where(somewhere, fits.argmax(axis=1), room.argmax(axis=1))
        expected = paths[np.arange(COUNT), where]
        np.testing.assert_allclose(position[drawn, due], expected[drawn], atol=1e-5)
        # Where nothing has room, only an episode without a box so far gets the roomiest place.
        late = drawn & ~somewhere
        assert not active[late, due - 1].any() and (room[late].max(axis=1, initial=-1) > 0.01).all()
        np.testing.assert_array_equal(position[~drawn, due], position[~drawn, due - 1])
        first_places += (drawn & somewhere).sum()
        instead += late.sum()
    assert first_places > 200 and instead > 5


def test_the_box_changes_only_when_it_is_due(episodes):
    position = np.asarray(episodes[0].position)[:, :, 0]
    changed = (position[:, 1:] != position[:, :-1]).any(axis=(0, 2))
    assert set(np.nonzero(changed)[0] + 1) <= set(DUE)
    active = np.asarray(episodes[0].active)[..., 0]
    assert not active[:, : DUE[0]].any()
    assert active[:-STILL, DUE[0]].mean() > 0.9


def test_edges_are_as_long_as_the_level_says(episodes):
    half = np.asarray(episodes[0].half_size)[:, 600, 0]
    there = np.asarray(episodes[0].active)[:, 600, 0]
    for level, shortest, longest in ((1, 0.025, 0.15), (2, 0.05, 0.1)):
        here = half[level - 1 :: 2][there[level - 1 :: 2]]
        assert shortest <= here.min() < 1.2 * shortest
        assert 0.95 * longest < here.max() <= longest


def test_an_episode_without_a_box_is_not_valid(episodes):
    appeared = np.asarray(episodes[0].active).any(axis=(1, 2))
    np.testing.assert_array_equal(np.asarray(episodes[1]), appeared)
    assert not appeared[-STILL:].any()


def test_the_box_is_gone_100_steps_before_the_end(episodes):
    active = np.asarray(episodes[0].active)
    assert active[:, 899].any()
    assert not active[:, 900:].any()


def test_without_a_witness_the_way_is_the_straight_line(on_their_way):
    way = replace(on_their_way, witness=None).way()
    np.testing.assert_allclose(way, on_their_way.witness, atol=1e-5)
    assert way.shape == (COUNT, WAY_POINTS, PANDA.joints)
