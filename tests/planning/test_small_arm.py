"""Planning asks the robot, not the Panda: an arm of four joints finds poses and ways."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from drpbench.compile import jit
from drpbench.errors import DrpbenchError
from drpbench.generation.certificate import certify
from drpbench.geometry import Obstacles
from drpbench.geometry.host_rotation import from_matrix
from drpbench.planning import ik, motion
from drpbench.planning.checker import mesh_checker, sphere_checker
from drpbench.planning.clearance_cost import clearance_cost, everywhere, gaps
from drpbench.planning.expert import PlannerSettings, planner
from drpbench.planning.joint_limits import inner_limits
from drpbench.planning.mink_ik import InverseKinematics
from drpbench.planning.retiming import retime
from drpbench.planning.rrt_connect import Planner
from drpbench.planning.stopping import touches

from ..scenes import boxes
from .small_arm import small_arm

WALL = ((0.4, 0.0, 0.2), (0.15, 0.01, 0.2))
LEFT, RIGHT = (np.array([side, -0.3, 0.8, 0.6], np.float32) for side in (0.9, -0.9))
SETTINGS = PlannerSettings(waypoints=32, control_points=12, iterations=12, vias=3)


@pytest.fixture(scope="module")
def robot(tmp_path_factory):
    return small_arm(tmp_path_factory.mktemp("small"))


@pytest.fixture(scope="module")
def checker(robot):
    return sphere_checker(0.045, robot)


def hold(checker, *placed):
    """Puts upright boxes (centre, half extents) into the checker."""
    centres, halves = (np.array(column) for column in zip(*placed, strict=True))
    turns = np.tile([1.0, 0.0, 0.0, 0.0], (len(placed), 1))
    checker.set_obstacles(Obstacles.boxes(halves, centres, turns))


def configurations(robot, count, seed=0):
    lower, upper = inner_limits(robot)
    rng = np.random.default_rng(seed)
    return rng.uniform(lower, upper, (count, robot.joints)).astype(np.float32)


def test_the_gaps_and_the_cost_are_of_its_own_spheres(robot, checker):
    hold(checker, WALL)
    obstacles, wanted = boxes(WALL), everywhere(0.3, robot)
    q = configurations(robot, 32)
    found = jit(jax.vmap(lambda q: gaps(q, obstacles, robot)))(q)
    for row, nearest in zip(q, np.asarray(found.obstacle).min(axis=1), strict=True):
        seen = [d for a, b, d in checker.contacts(row) if "obstacle" in a + b]
        expected = min([*seen, checker.margin])
        assert min(nearest, checker.margin) == pytest.approx(expected, abs=1e-5)
    evaluate = jit(jax.vmap(lambda q: clearance_cost(q, obstacles, wanted, robot)))
    step = 1e-3 * np.eye(robot.joints, dtype=np.float32)
    ahead, behind = (
        np.stack([evaluate(q + side * row)[0] for row in step], axis=1) for side in (1, -1)
    )
    gradient = np.asarray(evaluate(q)[1])
    # Where the nearest face changes within a step, differences say nothing.
    assert np.mean(np.abs(gradient - (ahead - behind) / 2e-3) < 0.02) > 0.95
    assert np.ptp(gradient, axis=0).min() > 0.2


@pytest.mark.slow
def test_inverse_kinematics_finds_the_poses_of_its_configurations(robot, checker):
    q = configurations(robot, 16, seed=1)
    positions, quaternions = [], []
    for row in q:
        position, matrix = checker.grip_pose(row)
        positions.append(position)
        quaternions.append(from_matrix(matrix))
    keys = jax.random.split(jax.random.key(0), len(q))
    solve = jit(jax.vmap(lambda p, t, key: ik.solve(p, t, key, seeds=16, robot=robot)))
    found = jax.tree.map(
        np.asarray,
        solve(jnp.asarray(positions, jnp.float32), jnp.asarray(quaternions, jnp.float32), keys),
    )
    assert found.q.shape == (16, 16, robot.joints)
    assert found.converged.any(axis=1).mean() > 0.8
    for pose, seed in zip(*np.nonzero(found.converged), strict=True):
        there, _ = checker.grip_pose(found.q[pose, seed])
        assert np.linalg.norm(there - positions[pose]) < 1.2 * ik.POSITION_TOLERANCE


@pytest.mark.slow
def test_the_expert_leads_it_past_a_wall_in_time(robot, checker):
    hold(checker, WALL)
    assert not Planner(checker, 0.005).straight(LEFT, RIGHT)
    batch = jax.tree.map(lambda leaf: leaf[None], (boxes(WALL), LEFT, RIGHT))
    plan = planner(SETTINGS, robot)(*batch, jax.random.key(0)[None], None)
    path = np.asarray(plan.path[0])
    assert path.shape == (32, robot.joints) and bool(plan.reached[0])
    assert certify(path, LEFT, RIGHT, checker, None).fault is None
    found = jit(lambda path: retime(path, robot=robot))(plan.path[0])
    speed = np.abs(np.diff(np.asarray(found.q), axis=0)) / (float(found.duration) / 255)
    assert speed.max() <= robot.velocity_limit.max()


def test_the_hosts_planner_and_inverse_kinematics_serve_it_too(robot, checker):
    hold(checker, WALL)
    rng = np.random.default_rng(0)
    path = Planner(checker, 0.006).plan(rng, LEFT.astype(float), RIGHT.astype(float), 20_000)
    assert path.shape[1] == robot.joints
    assert min(checker.clearance(q) for q in motion.samples(path, 0.01, robot)) > 0.0
    position, matrix = checker.grip_pose(LEFT)
    q = InverseKinematics(robot).solve(rng, position, from_matrix(matrix), checker, 0.0, seeds=20)
    assert np.linalg.norm(checker.grip_pose(q)[0] - position) < 2e-3


def test_an_arm_that_cannot_touch_itself_has_no_gaps_of_its_own(tmp_path):
    robot = small_arm(tmp_path, blocks=())

    @jit
    def judge(q):
        found = gaps(q, boxes(WALL), robot)
        cost = clearance_cost(q, boxes(WALL), everywhere(0.5, robot), robot)
        return found.own, touches(found), *cost

    own, contact, cost, gradient, _ = judge(jnp.asarray(LEFT))
    assert own.shape == (0,) and not contact
    assert cost > 0.0 and gradient.shape == (robot.joints,)


def test_an_arm_without_real_meshes_says_so(robot, tmp_path):
    with pytest.raises(DrpbenchError, match="'small', which has none"):
        mesh_checker(tmp_path, robot=robot)
