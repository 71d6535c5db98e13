"""Corrections begin where a policy drifted away, and lead to the goal without touching."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from drpbench.learning import corrections
from drpbench.learning.batches import along
from drpbench.learning.corrections import (
    STEPS,
    _hint,
    _interrupted,
    _stray,
    correct,
    fill_corrections,
)
from drpbench.learning.demonstrations import Shards, read
from drpbench.planning.clearance_cost import gaps
from drpbench.planning.path_check import check_path
from drpbench.policies import Straight

pytestmark = pytest.mark.slow


def walk(touch=None, arrive=None):
    """A straight walk towards a goal at 1 rad; it touches, or arrives, at a step."""
    share = np.minimum(np.arange(STEPS) / (arrive or 10 * STEPS), 1.0)
    walked = jnp.asarray(np.repeat(share[:, None], 7, axis=1), jnp.float32)
    room = jnp.full(STEPS, 0.1)
    return walked, room if touch is None else room.at[touch].set(-0.01), jnp.ones(7)


def kept(*walked, count=200):
    keys = jax.random.split(jax.random.key(0), count)
    q, usable = jax.jit(jax.vmap(lambda key: _stray(*walked, key)))(keys)
    steps = np.abs(np.asarray(walked[0])[None, :, 0] - np.asarray(q)[:, :1]).argmin(axis=1)
    return steps, np.asarray(usable)


def test_what_is_kept_is_before_the_touch_mostly_just_before():
    steps, usable = kept(*walk(touch=50))
    assert usable.all() and steps.max() == 49
    assert 0.6 < np.mean(steps >= 44) < 0.9


def test_what_is_kept_is_not_at_the_goal_yet():
    steps, usable = kept(*walk(arrive=80))
    assert usable.all() and steps.max() < 0.96 * 80 and steps.min() < 10


def test_an_episode_that_touches_at_once_gives_nothing():
    assert not kept(*walk(touch=0))[1].any()


def test_a_hint_joins_the_old_path_and_ends_where_it_does():
    path = jnp.linspace(0.0, 1.0, 64)[:, None] * jnp.ones(7)
    q = path[30] + 0.01
    hint = np.asarray(_hint(path, q))
    np.testing.assert_allclose(hint[0], q)
    np.testing.assert_allclose(hint[1], path[33 if abs(q[0] - path[30, 0]) < 0.008 else 34])
    np.testing.assert_allclose(hint[-1], path[-1])


@pytest.fixture(scope="module")
def corrected(demonstrations):
    patch = pytest.MonkeyPatch()
    patch.setattr(corrections, "batch_size", lambda: demonstrations.count)
    yield correct(Straight(), demonstrations, seed=0)
    patch.undo()


def boxes_more(demonstrations, corrected):
    """How many obstacles each corrected scene has more than the demonstrated one."""
    count = dict(
        zip(demonstrations.index.tolist(), demonstrations.obstacles.mask.sum(axis=1), strict=True)
    )
    return corrected.obstacles.mask.sum(axis=1) - [
        count[index] for index in corrected.index.tolist()
    ]


@jax.jit
@jax.vmap
def seen(path, obstacles):
    """Whether a path passes the check, and the room [m] where it begins."""
    scene = obstacles.primitives()
    return check_path(path, scene).free, gaps(path[0], scene).obstacle.min()


@jax.jit
def nearest(q, box):
    """[m] the least gap at each of `q` to a box of its own."""
    return jax.vmap(lambda q, box: gaps(q, box).obstacle.min())(q, box)


@jax.jit
def nearest_on_way(way, boxes):
    """[m] the least gap along one way to each of the boxes."""
    one = jax.vmap(lambda q, box: gaps(q, box).obstacle.min(), (0, None))
    return jax.vmap(lambda box: one(way, box).min())(boxes)


def test_corrections_are_free_and_end_at_the_goal(demonstrations, corrected):
    more = boxes_more(demonstrations, corrected)
    assert set(more.tolist()) == {0, 1}
    for boxes, least in ((0, 0.5), (1, 0.2)):
        assert least * demonstrations.count <= (more == boxes).sum() <= demonstrations.count
    found = jax.tree.map(jnp.asarray, corrected)
    free, room = seen(found.path, found.obstacles)
    assert free.all() and (room > 0.0).all()
    ends = np.abs(corrected.path[:, -1] - corrected.goal).max(axis=1)
    assert (ends[corrected.reached] == 0.0).all() and corrected.reached[more == 0].all()


def test_a_box_that_appears_leaves_room_where_the_arm_is_and_stands_on_its_way(demonstrations):
    """Where the goal is blocked, it stands on it; else the goal stays as free as it was."""
    one = jax.tree.map(lambda leaf: jnp.asarray(leaf[0]), demonstrations)
    keys = jax.random.split(jax.random.key(1), 40)
    room = jnp.full(STEPS, 0.1)
    walked = along(one.path, jnp.linspace(0.0, 1.0, STEPS))
    interrupted = jax.jit(jax.vmap(lambda key: _interrupted(one, walked, room, key)))
    scenes, q, placed = interrupted(keys)
    assert 0.3 < placed.mean() <= 1.0
    slot = int(np.argmin(one.obstacles.mask))
    only = jax.tree.map(lambda leaf: leaf[:, slot : slot + 1], scenes.obstacles.primitives())

    assert (nearest(q, only)[placed] > 0.019).all()
    at_goal = nearest(jnp.broadcast_to(one.goal, (40, 7)), only)[placed]
    assert ((at_goal < 0.0) | (at_goal > 0.019)).all() and 0.1 < (at_goal < 0.0).mean() < 0.7
    assert (nearest_on_way(walked, only)[placed] < 0.0).all()


def test_corrections_begin_off_the_demonstrated_path(demonstrations, corrected):
    starts = dict(
        zip(
            np.asarray(demonstrations.index).tolist(),
            np.asarray(demonstrations.path[:, 0]),
            strict=True,
        )
    )
    moved = [
        np.abs(path[0] - starts[index]).max()
        for index, path in zip(corrected.index.tolist(), corrected.path, strict=True)
    ]
    assert np.mean(np.array(moved) > 0.02) > 0.7


def test_shards_go_on_where_they_stopped(demonstrations, tmp_path, monkeypatch):
    asked = []

    def answer(policy, some, seed, robot):
        asked.append(some.index.tolist())
        return jax.tree.map(np.asarray, some)

    monkeypatch.setattr(corrections, "correct", answer)
    monkeypatch.setattr(corrections, "SHARD", 4)
    monkeypatch.setattr(corrections, "batch_size", lambda: 2)
    shards = Shards(tmp_path / "c", "corrections-x")
    fill_corrections(shards, Straight(), demonstrations, 4, 0, lambda *_: None)
    first = list(asked)
    fill_corrections(shards, Straight(), demonstrations, 7, 0, lambda *_: None)
    index = demonstrations.index[:7].tolist()
    assert sum(first, []) == index[:4] and sum(asked, []) == index
    assert read(tmp_path / "c").index.tolist() == index
