"""A problem depends on its numbers and its stream, and comes with its certificate."""

import jax
import numpy as np
import pytest

from drpbench.generation import certificate, generator
from drpbench.generation.composition import COMPOSITION, group_of
from drpbench.problems import load_set


@pytest.fixture(scope="module")
def maker(spheres):
    return generator.Generator(spheres, None)


def fields(draft):
    scene = draft.scene
    return [
        *jax.tree.leaves(scene.obstacles),
        *(draft.start, draft.goal, draft.goal_position, draft.goal_quaternion, draft.witness),
    ]


@pytest.mark.parametrize(("task", "index"), [("SE", 25), ("SE", 29), ("FDO", 1), ("DGB", 3)])
def test_the_same_numbers_make_the_same_problem(task, index, maker):
    first = fields(maker.problem(task, index))
    maker.problem("SAO", 0)  # what was made in between does not matter
    for a, b in zip(first, fields(maker.problem(task, index)), strict=True):
        assert a.dtype == b.dtype and np.array_equal(a, b)


@pytest.mark.parametrize(("task", "index"), [("SE", 0), ("SAO", 1), ("FDO", 1), ("DGB", 3)])
def test_the_frozen_problems_are_what_it_makes(task, index, spheres, meshes):
    draft = generator.Generator(spheres, meshes).problem(task, index)
    stored = load_set().task(task)
    pairs = [
        (draft.start, stored.start[index]),
        (draft.goal, stored.goal[index]),
        (draft.goal_position, stored.goal_position[index]),
        (draft.goal_quaternion, stored.goal_quaternion[index]),
        (draft.witness, stored.witness[index]),
        *zip(
            jax.tree.leaves(draft.scene.obstacles),
            jax.tree.leaves(stored.obstacles[index].present()),
            strict=True,
        ),
    ]
    for made, frozen in pairs:
        assert made.dtype == frozen.dtype and np.array_equal(made, frozen)


def test_another_stream_or_number_makes_another_problem(maker):
    base = maker.problem("SE", 25)
    other_stream = maker.problem("SE", 25, stream="training")
    other_number = maker.problem("SE", 57)
    assert other_number.group == base.group
    assert not np.array_equal(base.start, other_stream.start)
    assert not np.array_equal(base.start, other_number.start)


@pytest.mark.parametrize("index", range(32))
def test_every_group_of_the_static_task_yields_certified_problems(index, maker, spheres):
    draft = maker.problem("SE", index, stream="tests")
    spheres.set_obstacles(draft.scene.obstacles)
    start, goal, witness = (x.astype(float) for x in (draft.start, draft.goal, draft.witness))
    assert certificate.certify(witness, start, goal, spheres, None).fault is None
    distance = np.linalg.norm(spheres.grip_pose(start)[0] - draft.goal_position)
    assert distance >= group_of("SE", index).distance - 1e-6
    for kind, q in zip(draft.group.pair, (start, goal), strict=True):
        least = generator.FREE_CLEARANCE if kind == "f" else generator.TIGHT_CLEARANCE
        assert spheres.clearance(q) > least - 1e-4


def test_dynamic_goal_blocking_starts_at_its_goal(maker):
    for index in range(len(COMPOSITION["DGB"])):
        draft = maker.problem("DGB", index, stream="tests")
        assert np.array_equal(draft.start, draft.goal)
        assert draft.witness.shape == (1, 7)
