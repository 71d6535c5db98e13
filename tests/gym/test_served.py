"""Problems to learn from in the tasks' form: free by an engine of its own, and none of the
benchmark's."""

import jax
import numpy as np
import pytest

from drpbench.envs import TASKS, World
from drpbench.geometry import signed_distance
from drpbench.gym.served import Frozen, Training, source
from drpbench.problems import ProblemSetError, load_set
from drpbench.robot import PANDA
from drpbench.rollout import instance_key

# Numbers 2 and 8 have a box on their goal, so that 3 and 9 stand for them; 1 and 10 are on the
# bare table.
IDS = [*range(11), 25]


@pytest.fixture(scope="module")
def training():
    return {name: Training(World(TASKS[name])).take(IDS) for name in ("FDO", "DGB")}


@jax.jit
@jax.vmap
def clearances(joints, obstacles):
    spheres = PANDA.moving_spheres
    centers = spheres.world(PANDA.link_poses(joints))
    return (signed_distance(centers, obstacles) - spheres.radius).min()


@pytest.mark.parametrize("task", ["FDO", "DGB"])
def test_start_and_goal_are_free(training, task):
    problem = training[task]
    assert (np.asarray(clearances(problem.start, problem.obstacles)) > 0.0).all()
    assert (np.asarray(clearances(problem.goal, problem.obstacles)) > 0.0).all()


def test_the_goal_pose_is_the_goals(training):
    from scipy.spatial.transform import Rotation

    problem = training["FDO"]
    position, rotation = jax.vmap(lambda q: PANDA.grip_pose(PANDA.link_poses(q)))(problem.goal)
    np.testing.assert_allclose(problem.goal_position, position, atol=1e-6)
    given = Rotation.from_quat(problem.goal_quaternion, scalar_first=True).as_matrix()
    np.testing.assert_allclose(given, rotation, atol=1e-5)


def test_levels_are_the_tasks_own(training):
    assert training["FDO"].level.tolist() == [2, 1, 2, 2, 1, 2, 2, 1, 1, 1, 1, 2]
    assert training["DGB"].level.tolist() == [1, 1, 1, 2] * 2 + [1] * 4


def test_a_box_on_the_goal_is_passed_over(training):
    assert (training["FDO"].goal[2] == training["FDO"].goal[3]).all()
    assert training["FDO"].id.tolist() == IDS


def test_only_dgb_begins_at_its_goal(training):
    assert (training["DGB"].start == training["DGB"].goal).all()
    assert (training["FDO"].start != training["FDO"].goal).any(axis=1).all()


@pytest.mark.parametrize("task", ["FDO", "SE"])
def test_no_problem_is_one_of_the_benchmarks(training, task):
    drawn = training["FDO"]
    frozen = load_set().task(task)
    assert not (frozen.goal[:, None] == drawn.goal).all(axis=2).any()
    own, other = (instance_key(0, task, 3, source.stream) for source in (Frozen, Training))
    assert (jax.random.key_data(own) != jax.random.key_data(other)).any()


def test_a_number_that_there_is_not_is_refused():
    with pytest.raises(ValueError, match="no training problem -1; ids go from 0 to 2147483647"):
        Training(World(TASKS["SE"])).require([0, -1])


def test_problems_of_a_set_are_served_by_number():
    shown = source(load_set(), World(TASKS["FDO"]))
    assert shown.stream == Frozen.stream
    np.testing.assert_array_equal(shown.take([3]).goal, load_set().task("FDO").goal[[3]])
    with pytest.raises(ProblemSetError, match="no problem 200 in FDO"):
        shown.require([200])
    with pytest.raises(ValueError, match="there are: frozen, training"):
        source("mine", World(TASKS["FDO"]))
