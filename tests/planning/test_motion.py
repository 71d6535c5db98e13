"""The bound on how far a joint motion moves the arm."""

import numpy as np

from drpbench.generation.certificate import RESOLUTION
from drpbench.planning import motion
from drpbench.robot import PANDA


def surface(checker, q):
    """Points on the arm at `q`: each sphere's six poles, (s, 3)."""
    checker.clearance(q)
    moving = np.flatnonzero(checker.model.geom_bodyid > 1)
    moving = moving[
        [
            not checker.model.body(checker.model.geom_bodyid[g]).name.startswith("slot")
            for g in moving
        ]
    ]
    turns = checker.data.xmat[checker.model.geom_bodyid[moving]].reshape(-1, 3, 3)
    radii = checker.model.geom_size[moving, 0]
    poles = np.concatenate([np.eye(3), -np.eye(3)])
    offsets = np.einsum("gij,pj->gpi", turns, poles) * radii[:, None, None]
    return (checker.data.geom_xpos[moving][:, None] + offsets).reshape(-1, 3)


def test_no_point_of_the_arm_moves_farther_than_the_bound(spheres):
    rng = np.random.default_rng(0)
    largest = np.zeros(7)
    for _ in range(300):
        a = rng.uniform(PANDA.joint_lower, PANDA.joint_upper)
        for joint in range(7):
            b = a.copy()
            b[joint] += 1e-3
            moved = np.linalg.norm(surface(spheres, b) - surface(spheres, a), axis=1).max()
            assert moved <= motion.bound(a, b)
            largest[joint] = max(largest[joint], moved / 1e-3)
        b = a + rng.normal(0, 0.2, 7)
        moved = np.linalg.norm(surface(spheres, b) - surface(spheres, a), axis=1).max()
        assert moved <= motion.bound(a, b)
    assert np.all(largest > 0.6 * PANDA.lever), "the bound is not idle"


def test_samples_are_close_and_hit_every_waypoint():
    rng = np.random.default_rng(1)
    waypoints = rng.uniform(PANDA.joint_lower, PANDA.joint_upper, (4, 7))
    path = motion.samples(waypoints, RESOLUTION)
    steps = [motion.bound(a, b) for a, b in zip(path[:-1], path[1:], strict=True)]
    assert max(steps) <= RESOLUTION + 1e-12
    for waypoint in waypoints:
        assert np.abs(path - waypoint).max(axis=1).min() < 1e-12


def test_a_single_waypoint_is_its_own_sample():
    q = np.ones((1, 7))
    assert np.array_equal(motion.samples(q, RESOLUTION), q)
