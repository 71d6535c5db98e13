"""Training problems are free of collision, repeatable, and never the benchmark's."""

from dataclasses import replace

import jax
import numpy as np
import pytest

from drpbench.generation.training_problems import (
    AT_HOME,
    OBSTRUCTED_SHARE,
    TRAINING_STREAM,
    VALIDATION_STREAM,
    Drawer,
    evenly,
)
from drpbench.planning.checker import sphere_checker
from drpbench.planning.motion import samples
from drpbench.problems import load_set
from drpbench.robot import PANDA


@pytest.fixture(scope="module")
def checker():
    return sphere_checker()


def test_a_problem_depends_on_its_number_alone(drawn):
    again = Drawer("tests").draw(7)
    for name in ("start", "goal", "hint"):
        assert np.array_equal(getattr(again, name), getattr(drawn[7], name)), name
    for found, expected in zip(
        jax.tree.leaves(again.obstacles), jax.tree.leaves(drawn[7].obstacles), strict=True
    ):
        assert np.array_equal(found, expected)


def test_starts_are_free_and_goals_are_as_they_are_said_to_be(drawn, checker):
    assert 0 < sum(one.obstructed for one in drawn) < len(drawn)
    for one in drawn:
        checker.set_obstacles(one.obstacles)
        assert checker.free(one.start)
        assert checker.free(one.goal) != one.obstructed
        assert np.array_equal(one.hint[0], one.start) and np.array_equal(one.hint[-1], one.goal)


def test_hints_lead_round_all_that_does_not_stand_on_the_goal(drawn, checker):
    for one in drawn:
        if not one.obstructed:
            checker.set_obstacles(one.obstacles)
            # Even steps cut the corners of the planner's path, which kept 6.5 mm.
            assert min(checker.clearance(q) for q in samples(one.hint.astype(float), 0.02)) > -0.01


@pytest.mark.slow
def test_the_obstructed_share_is_what_is_stated():
    drawer = Drawer("tests", families=("table", "box"))
    count = 150
    share = np.mean([drawer.draw(number).obstructed for number in range(1000, 1000 + count)])
    assert abs(share - OBSTRUCTED_SHARE) < 3.5 * np.sqrt(OBSTRUCTED_SHARE / count)


def leaked(drawn):
    """Of problems, those whose start, goal or scene is one of the benchmark's."""
    ends, scenes = set(), set()
    for problems in load_set().problems.values():
        ends |= {row.tobytes() for row in np.concatenate([problems.start, problems.goal])}
        for id in range(problems.count):
            if problems.family[id] != "table":  # the bare table is everybody's
                scenes.add(content(problems.obstacles[id]))
    return [
        one
        for one in drawn
        if {one.start.tobytes(), one.goal.tobytes()} & ends or content(one.obstacles) in scenes
    ]


def content(obstacles):
    there = obstacles.present()
    return b"".join(np.ascontiguousarray(x).tobytes() for x in (there.half_size, there.position))


@pytest.mark.slow
def test_no_test_problem_is_among_those_learned_from():
    for stream in (TRAINING_STREAM, VALIDATION_STREAM):
        drawer = Drawer(stream, families=AT_HOME)
        drawn = [drawer.draw(number) for number in range(24)]
        assert leaked(drawn) == []
        # One of the benchmark's among them would be found, by its ends or by its scene alone.
        test = load_set().task("SE")
        same_ends = replace(drawn[0], start=test.start[7], goal=test.goal[7])
        same_scene = replace(drawn[1], obstacles=test.obstacles[9])
        assert leaked([*drawn, same_ends, same_scene]) == [same_ends, same_scene]


def test_the_streams_differ():
    a, b = Drawer(TRAINING_STREAM).draw(0), Drawer(VALIDATION_STREAM).draw(0)
    assert not np.array_equal(a.start, b.start)


def test_the_benchmarks_own_stream_is_refused():
    with pytest.raises(ValueError, match="expected families of .*, got none"):
        Drawer(families=())
    with pytest.raises(ValueError, match="expected families of .*, got attic"):
        Drawer(families=("table", "attic"))
    with pytest.raises(ValueError, match="not for learning"):
        Drawer("benchmark")


def test_even_steps_take_even_times():
    path = np.array([np.zeros(7), np.full(7, 1.0), np.full(7, 1.1)])
    steps = (np.abs(np.diff(evenly(path, 33), axis=0)) / PANDA.velocity_limit).max(axis=1)
    assert np.allclose(steps, steps[0], rtol=1e-6)
    assert np.allclose(evenly(path[:1], 5), 0.0)
