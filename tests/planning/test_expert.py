"""The expert's plans, judged by C MuJoCo's spheres and by what they promise."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from drpbench.compile import jit
from drpbench.generation.certificate import certify
from drpbench.geometry import Obstacles, Primitives, stacked
from drpbench.planning import clearance_cost as cost
from drpbench.planning.checker import sphere_checker
from drpbench.planning.expert import CHEAP, PlannerSettings, planner
from drpbench.planning.joint_limits import inner_limits
from drpbench.planning.path_check import CLEARANCE, check_path
from drpbench.planning.stopping import STOP_CLEARANCE
from drpbench.robot import PANDA

from ..scenes import boxes, postures

pytestmark = pytest.mark.slow

LEFT, RIGHT = (PANDA.home + [side, 0, 0, 0, 0, 0, 0] for side in (1.3, -1.3))
LEFT, RIGHT = LEFT.astype(np.float32), RIGHT.astype(np.float32)
TABLE = ((0.4, 0.0, -0.025), (0.9, 1.0, 0.025))
WALL = ((0.4, 0.0, 0.3), (0.25, 0.01, 0.3))  # the arm can go over it
BARRIER = [
    ((side * 0.69, 0.0, 0.8), (0.55, 0.01, 0.8)) for side in (1, -1)
]  # there is no way round
WIDTH, COUNT = 3, 4


@pytest.fixture(scope="module")
def spheres():
    return sphere_checker(0.045)


def placed(spheres, obstacles):
    """The checker, holding these boxes of no rotation."""
    there = np.asarray(obstacles.mask)
    upright = np.tile([1.0, 0.0, 0.0, 0.0], (there.sum(), 1))
    spheres.set_obstacles(
        Obstacles.boxes(obstacles.half_size[there], obstacles.position[there], upright)
    )
    return spheres


@pytest.fixture(scope="module")
def real(drawn):
    """Drawn problems and their plans, with hints and with the straight line in the hints' place."""

    def stack(name):
        return np.stack([getattr(one, name) for one in drawn])

    obstacles = stacked([one.obstacles for one in drawn]).primitives()
    start, goal, hints = stack("start"), stack("goal"), stack("hint")
    lines = start[:, None] + np.linspace(0, 1, hints.shape[1])[:, None] * (goal - start)[:, None]
    keys = jax.random.split(jax.random.key(0), len(drawn))
    plan = partial(planner(CHEAP), obstacles, start, goal, keys)
    found = [plan(given[:, None].astype(np.float32)) for given in (hints, lines)]
    return drawn, *(jax.tree.map(np.asarray, plans) for plans in found)


def test_most_real_problems_are_solved_and_hints_are_what_solves_the_hard_ones(real):
    drawn, hinted, plain = real
    assert hinted.success.sum() >= 0.9 * len(drawn)
    assert np.all(hinted.reached | ~plain.reached)
    assert hinted.reached.sum() > plain.reached.sum()
    np.testing.assert_array_equal(hinted.obstructed, [one.obstructed for one in drawn])
    np.testing.assert_array_equal(hinted.reached, hinted.success & ~hinted.obstructed)


def test_an_independent_engine_certifies_every_plan_that_claims_success(real, spheres):
    drawn, *both = real
    certified = 0
    for plans in both:
        for one, path, success, room in zip(
            drawn, plans.path, plans.success, plans.clearance, strict=True
        ):
            if not success:
                continue
            spheres.set_obstacles(one.obstacles)
            proof = certify(path, one.start, path[-1], spheres, None)
            assert proof.fault is None
            if proof.sphere_clearance < spheres.margin:
                assert proof.sphere_clearance == pytest.approx(room, abs=1e-3)
            certified += 1
    assert certified > len(drawn)


def test_plans_end_at_the_goal_or_as_near_to_it_as_there_is_room(real, spheres):
    drawn, hinted, _ = real
    stops = []
    for one, path, reached, success in zip(
        drawn, hinted.path, hinted.reached, hinted.success, strict=True
    ):
        if reached:
            np.testing.assert_array_equal(path[-1], one.goal)
        elif success:
            spheres.set_obstacles(one.obstacles)
            stops.append(spheres.clearance(path[-1]))
            # A step farther towards the goal would come closer to what is in the way than is safe.
            onwards = path[-1] + 0.1 * (one.goal - path[-1])
            assert spheres.clearance(onwards) < stops[-1] + 2e-3
            assert np.linalg.norm(path[-1] - one.goal) < np.linalg.norm(one.start - one.goal)
    assert len(stops) >= 3
    assert min(stops) >= CLEARANCE - 1e-4
    assert 0.5 * STOP_CLEARANCE < np.median(stops) < STOP_CLEARANCE + 1e-3


def test_waypoints_are_evenly_spaced_and_the_length_is_theirs(real):
    _, plans, _ = real
    steps = (np.abs(np.diff(plans.path, axis=1)) / PANDA.velocity_limit).max(axis=2)
    np.testing.assert_allclose(steps.sum(axis=1), plans.length, rtol=4e-3)
    # Resampling a curve cuts its bends by little.
    assert np.all(np.ptp(steps, axis=1) < 0.15 * steps.mean(axis=1))


def test_paths_keep_their_margin_from_joint_limits(real):
    drawn, plans, _ = real
    for one, path in zip(drawn, plans.path, strict=True):
        lower = np.minimum(inner_limits(PANDA)[0], np.minimum(one.start, one.goal))
        upper = np.maximum(inner_limits(PANDA)[1], np.maximum(one.start, one.goal))
        assert np.all(path >= lower - 1e-5) and np.all(path <= upper + 1e-5)


@pytest.fixture(scope="module")
def plan_all():
    """Plans for up to COUNT cases (obstacles, start, goal), by via points and without hints."""
    compiled = planner(PlannerSettings(iterations=20, vias=3, stop_short=True))

    def plan(*cases, seed=0):
        filled = [cases[i % len(cases)] for i in range(COUNT)]
        obstacles, start, goal = jax.tree.map(lambda *leaves: np.stack(leaves), *filled)
        keys = jnp.stack([jax.random.key(seed)] * COUNT)
        plans = jax.tree.map(np.asarray, compiled(obstacles, start, goal, keys, None))
        return [jax.tree.map(lambda leaf, i=i: leaf[i, ...], plans) for i in range(len(cases))]

    return plan


def test_the_straight_line_comes_out_where_it_is_free(plan_all):
    for plan in plan_all(
        (boxes(TABLE, width=WIDTH), LEFT, RIGHT),
        (boxes(width=WIDTH), RIGHT, PANDA.home.astype("f")),
    ):
        line = plan.path[0] + np.linspace(0, 1, 64)[:, None] * (plan.path[-1] - plan.path[0])
        assert plan.reached and not plan.obstructed
        np.testing.assert_allclose(plan.path, line, atol=1e-3)


def test_a_wall_is_passed_with_room_to_spare_and_a_masked_one_ignored(plan_all, spheres):
    wall, table = boxes(TABLE, WALL, width=WIDTH), boxes(TABLE, width=WIDTH)
    masked = Primitives(wall.kind, wall.half_size, wall.position, wall.rotation, mask=table.mask)
    around, straight, through = plan_all(
        (wall, LEFT, RIGHT), (table, LEFT, RIGHT), (masked, LEFT, RIGHT)
    )
    proof = certify(around.path, LEFT, RIGHT, placed(spheres, wall), None)
    assert around.reached and proof.fault is None
    assert proof.sphere_clearance > 0.015
    assert np.abs(around.path - straight.path).max() > 0.1
    np.testing.assert_array_equal(through.path, straight.path)


def test_plans_are_a_function_of_their_key_and_not_of_their_batch(plan_all):
    case = (boxes(TABLE, WALL, width=WIDTH), LEFT, RIGHT)
    other = (boxes(TABLE, width=WIDTH), RIGHT, LEFT)
    (first,), (again,) = plan_all(case), plan_all(case)
    np.testing.assert_array_equal(first.path, again.path)
    np.testing.assert_array_equal(first.path, plan_all(other, case)[1].path)


def test_a_free_goal_that_is_not_reached_is_told_from_an_obstructed_one(plan_all, spheres):
    # With a lid, or the arm gets through the gap about its own base, upright.
    lid = ((0.0, 0.0, 0.85), (0.3, 0.3, 0.02))
    barrier = boxes(TABLE, *BARRIER, lid, width=WIDTH + 1)
    around_goal = boxes(TABLE, ((0.08, -0.3, 0.45), (0.08, 0.08, 0.08)), width=WIDTH + 1)
    beyond, blocked = plan_all((barrier, LEFT, RIGHT), (around_goal, LEFT, RIGHT))
    assert (bool(beyond.obstructed), bool(blocked.obstructed)) == (False, True)
    for plan, obstacles in ((beyond, barrier), (blocked, around_goal)):
        assert plan.success and not plan.reached
        proof = certify(plan.path, LEFT, plan.path[-1], placed(spheres, obstacles), None)
        assert proof.fault is None
        assert np.linalg.norm(plan.path[-1] - RIGHT) < 0.9 * np.linalg.norm(LEFT - RIGHT)


def test_a_start_in_collision_is_no_success(plan_all):
    on_start = boxes(TABLE, ((0.08, 0.3, 0.45), (0.08, 0.08, 0.08)), width=WIDTH)
    (plan,) = plan_all((on_start, LEFT, RIGHT))
    assert not plan.success and not plan.reached


def test_the_check_sees_the_arm_in_itself_and_limits_and_thin_walls(spheres):
    check = jit(jax.vmap(check_path, (0, None)))
    folded = np.array([0.0, -1.0, 0.0, -3.0, 0.0, 0.5, 0.0], np.float32)
    beyond = LEFT.copy()
    beyond[0] = PANDA.joint_upper[0] + 0.02
    ends = [(LEFT, RIGHT), (LEFT, folded), (LEFT, beyond), (LEFT, PANDA.home.astype("f"))]
    paths = np.stack([a + np.linspace(0, 1, 8, dtype="f")[:, None] * (b - a) for a, b in ends])
    slat = ((0.35, -0.2, 0.35), (0.25, 0.001, 0.35))
    for obstacles, expected in (
        (boxes(TABLE, width=WIDTH), [True, False, False, True]),
        (boxes(TABLE, slat, width=WIDTH), [False, False, False, True]),
    ):
        checker = placed(spheres, obstacles)
        found = check(jnp.asarray(paths), obstacles)
        assert np.asarray(found.free).tolist() == expected
        for path, free in zip(paths, expected, strict=True):
            assert (certify(path, path[0], path[-1], checker, None).fault is None) == free


def test_the_cost_has_the_gradient_of_finite_differences():
    obstacles = boxes(TABLE, WALL, width=WIDTH)
    wanted = cost.everywhere(0.3)
    evaluate = jit(jax.vmap(lambda q: cost.clearance_cost(q, obstacles, wanted)))
    q = postures(24, seed=2)
    step = 1e-3 * np.eye(7, dtype=np.float32)
    value, gradient, hessian = evaluate(jnp.asarray(q))
    ahead, behind = (
        np.stack([evaluate(jnp.asarray(q + side * row))[0] for row in step], axis=1)
        for side in (1, -1)
    )
    assert np.all(np.asarray(value) > 0.0)
    np.testing.assert_allclose(gradient, (ahead - behind) / 2e-3, rtol=0.02, atol=0.02)
    assert np.all(np.linalg.eigvalsh(np.asarray(hessian, float)) > -1e-3)


def test_gaps_are_the_checkers(spheres):
    obstacles = boxes(TABLE, WALL, width=WIDTH)
    rooms = jit(jax.vmap(lambda q: cost.gaps(q, obstacles)))(jnp.asarray(postures(48, seed=3)))
    checker = placed(spheres, obstacles)
    for q, nearest in zip(
        postures(48, seed=3), np.asarray(rooms.obstacle).min(axis=1), strict=True
    ):
        found = [d for a, b, d in checker.contacts(q) if "obstacle" in a + b]
        assert min([*found, checker.margin]) == pytest.approx(
            min(nearest, checker.margin), abs=1e-5
        )
