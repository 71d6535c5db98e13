"""Pieces that move, and their points."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from drpbench.compile import jit
from drpbench.envs import TASKS, World
from drpbench.geometry import signed_distance
from drpbench.problems import load_set
from drpbench.rollout import instance_key
from drpbench.viewer.furniture import SHARE, SPARE, Furniture, with_room

pytestmark = pytest.mark.slow

ID = 3
TASK = "GB"  # of its problems the odd ones are furnished


@pytest.fixture(scope="module")
def scene():
    problem = jax.tree.map(lambda leaf: np.asarray(leaf)[0, ...], load_set().task(TASK).take([ID]))
    key = instance_key(0, TASK, ID, 0)
    reset = jit(World(TASKS[TASK]).reset)
    return problem, reset(problem, key), reset(with_room(problem), key), key


@pytest.fixture
def furniture(scene):
    _, _, state, key = scene
    return Furniture(state, key)


def test_room_for_boxes_changes_nothing_that_there_is(scene):
    problem, plain, roomy, _ = scene
    assert roomy.problem.obstacles.count == problem.obstacles.count + SPARE
    assert int(roomy.problem.obstacles.mask.sum()) == int(problem.obstacles.mask.sum())
    np.testing.assert_allclose(plain.cloud.static_points, roomy.cloud.static_points, atol=1e-6)
    assert np.array_equal(plain.cloud.static_mask, roomy.cloud.static_mask)


def test_untouched_points_are_those_of_the_world_to_the_bit(scene, furniture):
    points, seen = furniture.points()
    assert np.array_equal(points, scene[2].cloud.static_points)
    assert np.array_equal(seen, scene[2].cloud.static_mask)


def test_a_pieces_points_lie_on_it_and_go_with_it(furniture):
    piece = int(np.flatnonzero(furniture.movable)[0])
    before, _ = furniture.points()
    furniture.position[piece] += np.array([0.1, -0.2, 0.3], np.float32)
    after, seen = furniture.points()
    moved = np.linalg.norm(after - before, axis=1) > 1e-3
    assert moved.sum() > 10 and seen.all()
    np.testing.assert_allclose((after - before)[moved], [[0.1, -0.2, 0.3]] * moved.sum(), atol=1e-6)
    alone = jax.tree.map(lambda leaf: leaf[piece : piece + 1], furniture.primitives())
    distance = np.asarray(signed_distance(jnp.array(after[moved]), alone))
    np.testing.assert_allclose(distance, 0.0, atol=1e-5)


def test_what_is_pushed_under_the_ground_is_not_seen(furniture):
    piece = int(np.flatnonzero(furniture.movable)[0])
    furniture.position[piece, 2] -= 5.0
    points, seen = furniture.points()
    assert 0 < (~seen).sum() < len(seen)
    assert (points[~seen] == 0.0).all() and (points[seen][:, 2] >= -1e-6).all()


def test_an_added_box_takes_its_share_of_points_and_gives_them_back(furniture):
    before, _ = furniture.points()
    half, place = np.array([0.05, 0.06, 0.07]), np.array([0.4, 0.1, 0.5])
    piece = furniture.add(half, place)
    assert piece == furniture.added[0] and furniture.movable[piece]
    after, _ = furniture.points()
    taken = (after != before).any(axis=1)
    assert taken.mean() == pytest.approx(SHARE, abs=0.03)
    on_box = np.abs(after[taken] - place) / half
    np.testing.assert_allclose(on_box.max(axis=1), 1.0, atol=1e-5)
    furniture.add(half, place + 1.0)  # the first one's points stay where they are
    both, _ = furniture.points()
    assert np.array_equal(both[taken], after[taken])
    furniture.remove_added()
    assert np.array_equal(furniture.points()[0], before)


def test_there_is_an_end_to_boxes(furniture):
    made = [furniture.add(np.full(3, 0.05), np.zeros(3)) for _ in range(SPARE + 1)]
    assert made == [*furniture.added, None]


def test_the_table_does_not_move(furniture):
    table = np.flatnonzero(furniture.present & ~furniture.movable)
    assert len(table) == 1
    assert furniture.half_size[table[0], 0] > 0.4  # [m]
