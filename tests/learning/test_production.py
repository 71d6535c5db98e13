"""Problems come in order of number from other processes; solved ones are kept whole, shard by
shard."""

import jax
import numpy as np

from drpbench.learning import production
from drpbench.learning.demonstrations import Shards, read
from drpbench.learning.production import SHARD, Problems, Production, fill


def test_a_problem_depends_on_its_stream_and_number_alone(drawn):
    problems = Problems("tests")
    for number in (3, 0):
        again = problems(number)
        assert again.index == number and np.array_equal(again.hint, drawn[number].hint)
    assert not np.array_equal(Problems("others")(0).hint, drawn[0].hint)


def test_processes_draw_what_this_one_draws_in_order(drawn, monkeypatch):
    monkeypatch.setattr(production, "batch_size", lambda: 2)
    # What was drawn, unsolved.
    monkeypatch.setattr(production, "solve", lambda drawn, robot: list(drawn))
    with Production("tests", workers=1) as source:
        batches = list(source.solved(range(1, 12)))
    assert [len(batch) for batch in batches] == [2, 2, 2, 2, 2, 1]
    for number, one in enumerate((one for batch in batches for one in batch), start=1):
        assert one.index == number and np.array_equal(one.goal, drawn[number].goal)


def test_the_paths_that_the_expert_solved_are_kept_with_their_scenes(drawn, monkeypatch):
    """The planner is replaced: it solves every second problem, by its hint."""

    def hints_as_plans(obstacles, start, goal, keys, hints):
        assert hints.shape == (4, 1, 64, 7) and obstacles.mask.shape[0] == len(keys) == 4
        return Plans(hints[:, 0], np.array([True, False, True, False]))

    class Plans:
        def __init__(self, path, success):
            self.path, self.success = path, success
            self.length, self.reached = np.arange(4.0, dtype=np.float32), success

    monkeypatch.setattr(production, "batch_size", lambda: 4)
    monkeypatch.setattr(production, "planner", lambda *settings: hints_as_plans)
    found = production.solve(drawn[4:7])  # the fourth place is filled up, and not kept
    assert list(found.index) == [4, 6] and list(found.length) == [0.0, 2.0]
    assert np.array_equal(found.path, np.stack([drawn[4].hint, drawn[6].hint]))
    for place, one in enumerate((drawn[4], drawn[6])):
        assert np.array_equal(found.obstacles.position[place], one.obstacles.position)


def test_only_missing_shards_are_made(demonstrations, tmp_path, monkeypatch):
    one = jax.tree.map(lambda leaf: np.asarray(leaf)[:1], demonstrations)
    asked = []

    class Source:
        def __init__(self, workers=None):
            assert workers == 3

        def __enter__(self):
            return self

        def __exit__(self, *error): ...

        def solved(self, numbers, drawn_one):
            asked.append((numbers.start, numbers.stop))
            for _ in numbers:
                drawn_one()
            yield one
            yield one

    monkeypatch.setattr(production, "Production", Source)
    shards, calls = Shards(tmp_path / "data", "training"), []
    shards.add(range(SHARD, 2 * SHARD), one)
    count = 3 * SHARD + 7
    fill(shards, range(count), 3, lambda drawn, solved: calls.append((drawn, solved)))
    assert asked == [(0, SHARD), (2 * SHARD, 3 * SHARD), (3 * SHARD, count)]
    assert calls[0] == (SHARD, 1) and np.sum(calls, axis=0).tolist() == [count, 7]
    assert len(shards.done) == 4 and read(tmp_path / "data").count == 7
    calls.clear()
    fill(shards, range(count), 3, lambda drawn, solved: calls.append((drawn, solved)))
    assert calls == [(count, 7)] and len(asked) == 3
