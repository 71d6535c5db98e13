"""RRT-Connect and shortcutting over the collision checker."""

import numpy as np

from drpbench.planning import motion
from drpbench.planning.rrt_connect import Planner
from drpbench.robot import PANDA

LEFT, RIGHT = PANDA.home + [0.8, 0, 0, 0, 0, 0, 0], PANDA.home - [0.8, 0, 0, 0, 0, 0, 0]
WALL = (0, (0.2, 0.01, 0.35), (0.55, 0.0, 0.35))
# A wall to either side of the base, with a slit too narrow for the elbow to turn in.
SIDES = ((0, (0.01, 0.5, 0.8), (0.0, 0.65, 0.8)), (0, (0.01, 0.5, 0.8), (0.0, -0.65, 0.8)))


def test_a_path_leads_round_a_wall_and_keeps_its_clearance(spheres, obstacles):
    spheres.set_obstacles(obstacles(WALL))
    planner, rng = Planner(spheres, 0.006), np.random.default_rng(0)
    assert not planner.straight(LEFT, RIGHT)
    path = planner.plan(rng, LEFT, RIGHT, 20_000)
    short = planner.shortcut(rng, path, 60)
    for found in (path, short):
        assert np.array_equal(found[0], LEFT) and np.array_equal(found[-1], RIGHT)
        assert min(spheres.clearance(q) for q in motion.samples(found, 0.01)) > 0.003
    lengths = [sum(map(motion.bound, p[:-1], p[1:])) for p in (path, short)]
    assert lengths[1] <= lengths[0]


def test_the_straight_line_is_taken_where_it_is_free(spheres, obstacles):
    spheres.set_obstacles(obstacles())
    path = Planner(spheres, 0.006).plan(np.random.default_rng(0), LEFT, RIGHT, 20_000)
    assert np.array_equal(path, [LEFT, RIGHT])


def test_without_a_way_the_search_ends_at_its_number_of_checks(spheres, obstacles):
    spheres.set_obstacles(obstacles(*SIDES))
    ahead = np.array([0.0, 0.4, 0.0, -2.2, 0.0, 2.6, 0.8])
    behind = ahead + [2.8, 0, 0, 0, 0, 0, 0]
    assert spheres.free(ahead, 0.006) and spheres.free(behind, 0.006)
    planner = Planner(spheres, 0.006)
    assert planner.plan(np.random.default_rng(0), ahead, behind, 1500) is None
    assert 1500 <= planner.checks < 1700
