"""The world behind the page, without a page."""

import math

import jax.numpy as jnp
import numpy as np
import pytest

from drpbench.contract import EPISODE, PROTOCOL
from drpbench.envs import TASKS, World
from drpbench.geometry import quaternion_to_matrix
from drpbench.plugins.host import Hosted
from drpbench.problems import ProblemSetError, load_set
from drpbench.ranking import load_dir
from drpbench.results.shipped import shipped_results
from drpbench.robot import PANDA
from drpbench.viewer import Simulation
from drpbench.viewer.simulation import FOLLOW_SPEED

from .conftest import FURNISHED

pytestmark = pytest.mark.slow


def finished(simulation, id):
    simulation.open(id)
    while simulation.clock < EPISODE.steps:
        simulation.step()
    return simulation


def judged(policy, task, ids):
    """Their shipped rows."""
    results = load_dir(shipped_results()).values()
    ours = [of for of in results if (of.header.policy, of.header.protocol) == (policy, PROTOCOL)]
    rows = [row for of in ours for row in of.rows]
    return [row for id in ids for row in rows if (row.task, row.id) == (task, id)]


def assert_the_same(simulation, row):
    verdict = simulation.verdict
    assert verdict.success == row.success and verdict.reached == row.reached
    assert verdict.collided == row.collided and verdict.valid == row.valid
    assert simulation.first_collision_link == row.first_collision_link
    if row.collided:  # another program rounds in the seventh digit
        assert abs(verdict.first_collision_step - row.first_collision_step) <= 1
    assert abs(row.min_clearance) > 1e-3, "choose a problem whose verdict is not narrow"


def test_an_untouched_episode_ends_as_in_a_run(compiled):
    ids = [FURNISHED, 2, 9, 33]
    found = judged("straight+dcp-rmp", "FDO", ids)
    assert {row.collided for row in found} == {True, False} == {row.success for row in found}
    for id, row in zip(ids, found, strict=True):
        assert_the_same(finished(compiled, id), row)
        assert not compiled.edited


def test_time_after_the_end_changes_no_verdict(compiled):
    verdict = finished(compiled, FURNISHED).verdict
    piece = compiled.add_box()
    compiled.move("piece", piece, compiled.look().arm[0][5])
    compiled.step()
    assert compiled.touching and compiled.verdict == verdict


def test_a_box_put_into_the_arm_is_a_contact(simulation):
    link5 = simulation.look().arm[0][5]
    piece = simulation.add_box()
    before = simulation.look()
    assert before.clearance > 0.0
    simulation.move("piece", piece, link5 + [0.0, 0.0, 0.08])
    assert simulation.look().clearance < 0.0
    simulation.step()
    verdict = simulation.verdict
    assert verdict.collided and verdict.first_collision_step == 0
    assert simulation.touching == simulation.first_collision_link and simulation.edited


def test_the_policy_gives_way_to_a_box_that_is_dragged_at_it(simulation):
    piece = simulation.add_box()
    hand = simulation.look().arm[0][8]
    simulation.move("piece", piece, hand + [0.3, 0.0, 0.0])
    simulation.step()
    assert not simulation.look().reaction.active  # nothing moves near the arm but itself
    simulation.move("piece", piece, hand, at_once=False)
    for _ in range(9):
        simulation.step()
    seen = simulation.look()
    assert seen.reaction.active
    assert np.linalg.norm(seen.modified[0] - seen.goal[0]) > 0.01
    center = simulation.furniture.position[piece]
    assert np.abs(seen.reaction.obstacle_point - center).max() == pytest.approx(0.06, abs=1e-4)


def test_what_is_dragged_follows_at_walking_pace_and_arrives(simulation):
    piece = int(np.flatnonzero(simulation.furniture.movable)[0])
    start = simulation.furniture.position[piece].copy()
    simulation.move("piece", piece, start + [0.0, 0.0, 0.5], at_once=False)
    assert np.array_equal(simulation.furniture.position[piece], start)
    heights = []
    for _ in range(40):
        simulation.step()
        heights.append(simulation.furniture.position[piece, 2] - start[2])
    steps = np.diff([0.0, *heights])
    assert steps.max() <= FOLLOW_SPEED * EPISODE.period + 1e-5
    assert heights[-1] == pytest.approx(0.5, abs=1e-5)
    assert np.argmax(np.isclose(heights, 0.5, atol=1e-5)) == math.ceil(0.5 / FOLLOW_SPEED * 60) - 1


def test_a_drifting_box_is_held_and_drifts_on(simulation):
    far = np.array([0.6, 0.5, 0.6], np.float32)
    simulation.move("box", 0, far, hold=True)
    for _ in range(30):
        simulation.step()
    assert np.linalg.norm(simulation.look().box_position[0] - far) < 0.004  # [m] of one step
    simulation.move("box", 0, far)
    for _ in range(30):
        simulation.step()
    assert np.linalg.norm(simulation.look().box_position[0] - far) > 0.02


def test_a_goal_that_is_moved_is_reached_by_its_joints(simulation):
    moment = simulation.look()
    place = moment.goal_position + np.array([0.0, 0.05, 0.05])
    assert simulation.move_goal(place, 2.0 * moment.goal_quaternion)
    joints = np.asarray(simulation.goal_joints)
    assert ((joints > PANDA.joint_lower) & (joints < PANDA.joint_upper)).all()
    position, rotation = PANDA.grip_pose(PANDA.link_poses(simulation.goal_joints))
    np.testing.assert_allclose(position, place, atol=2e-4)
    wanted = quaternion_to_matrix(jnp.array(simulation.look().goal_quaternion))
    np.testing.assert_allclose(rotation, wanted, atol=2e-3)
    assert simulation.edited


def test_a_goal_out_of_reach_stays_where_it_is(simulation):
    before = simulation.look()
    assert not simulation.move_goal(np.array([2.0, 0.0, 0.5]), before.goal_quaternion)
    after = simulation.look()
    assert np.array_equal(after.goal[0], before.goal[0]) and not simulation.edited


def test_reset_undoes_what_was_done(simulation):
    first = simulation.look()
    simulation.add_box()
    simulation.move("box", 0, np.array([0.5, 0.5, 0.5]))
    simulation.move_goal(first.goal_position + [0.0, 0.0, 0.05], first.goal_quaternion)
    for _ in range(5):
        simulation.step()
    simulation.reset()
    again = simulation.look()
    assert simulation.clock == 0 and not simulation.edited
    for name in ("points", "goal_position", "position_error", "box_position"):
        assert np.array_equal(getattr(first, name), getattr(again, name)), name


class Creep:
    """As a host policy: a twentieth of the way."""

    def reset(self, observation):
        self.steps = 0

    def act(self, observation):
        self.steps += 1
        if self.steps > 20:
            raise RuntimeError("tired")
        away = observation.goal_joints - observation.joint_position
        return observation.joint_position + 0.05 * away


def test_a_host_policy_drives_the_arm_and_its_failure_is_told(capsys):
    simulation = Simulation(World(TASKS["SE"]), Hosted(Creep(), Creep), load_set().task("SE"))
    simulation.open(3)
    for _ in range(20):
        simulation.step()
    moved = simulation.joint_position - simulation.problems.start[3]
    away = simulation.goal_joints - simulation.problems.start[3]
    assert 0.1 < np.dot(moved, away) / np.dot(away, away) < 1 - 0.95**20
    assert simulation.verdict.finite and not simulation.failure
    simulation.step()
    assert simulation.failure.startswith("raised: RuntimeError: tired")
    assert not simulation.verdict.finite and not simulation.verdict.success
    simulation.reset()
    assert not simulation.failure
    assert "tired" in capsys.readouterr().err


def test_a_problem_that_is_not_there_is_named(simulation):
    with pytest.raises(ProblemSetError, match="no problem 200 in FDO"):
        simulation.open(200)
