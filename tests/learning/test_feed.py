"""Demonstrations straight from the expert: they flow, the newest replace the oldest, faults are
told."""

import time

import jax
import numpy as np
import pytest

from drpbench.learning import feed as feeds
from drpbench.learning.demonstrations import DataError
from drpbench.learning.production import Production

pytestmark = pytest.mark.slow


class Source(Production):
    """Stands in for the expert: every problem is solved, and its path is its number."""

    def __init__(self, demonstrations, fails_at=None):
        self._one = jax.tree.map(lambda leaf: np.asarray(leaf)[:1], demonstrations)
        self._fails_at = fails_at

    def __call__(self, workers=None, robot=None):
        return self

    def __enter__(self):
        return self

    def __exit__(self, *error): ...

    def solved(self, numbers, drawn_one=lambda: None):
        for first in range(numbers.start, numbers.stop, 64):
            if self._fails_at is not None and first >= self._fails_at:
                raise RuntimeError("the expert broke")
            many = jax.tree.map(lambda leaf: np.repeat(leaf, 64, axis=0), self._one)
            index = np.arange(first, first + 64)
            yield type(many)(**{**vars(many), "index": index})


def test_the_newest_replace_the_oldest_round_and_round(demonstrations, monkeypatch):
    monkeypatch.setattr(feeds, "Production", Source(demonstrations))
    with feeds.Stream(capacity=600) as feed:
        resident = jax.tree.map(jax.numpy.asarray, feed.begin())
        assert resident.count == 600
        assert np.array_equal(np.unique(resident.index), np.arange(256))
        while feed.made < 2048:
            time.sleep(0.01)  # the thread that makes them needs its turn
            before = np.asarray(resident.index)
            resident = feed.refresh(resident)
            assert resident.count == 600
        after = np.asarray(resident.index)
        # Two blocks of 256 fit: the last two that were made are there, in their order.
        assert set(after[:512]) == set(range(feed.made - 512, feed.made))
        assert not np.array_equal(before, after)


def test_a_fault_of_the_expert_reaches_who_waits(demonstrations, monkeypatch):
    monkeypatch.setattr(feeds, "Production", Source(demonstrations, fails_at=128))
    with feeds.Stream(capacity=512) as feed, pytest.raises(RuntimeError, match="broke"):
        feed.begin()


def test_leaving_does_not_wait_for_a_full_queue(demonstrations, monkeypatch):
    monkeypatch.setattr(feeds, "Production", Source(demonstrations))
    with feeds.Stream(capacity=256) as feed:
        feed.begin()


def test_too_small_a_capacity_is_refused():
    with pytest.raises(DataError, match="at least 256"):
        feeds.Stream(capacity=100)


def test_a_folder_without_demonstrations_is_refused(tmp_path):
    with pytest.raises(DataError, match="drpbench data"):
        feeds.Folder(tmp_path)
