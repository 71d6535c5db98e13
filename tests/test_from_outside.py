"""A policy, an arm, a task, a sensor and a problem set of a stranger's, without touching the
package.

A stranger's network is in `tests/learning/test_own_network.py`.
"""

import json
from dataclasses import dataclass, replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import drpbench
from drpbench.contract import Problem, no_movers
from drpbench.envs.tasks.static import Static
from drpbench.evaluation.metrics import rows
from drpbench.geometry import BOX, Primitives, matrix_to_quaternion
from drpbench.robot.arms import ARMS

from .toy_arm import toy_arm

pytestmark = pytest.mark.slow

START, GOAL = np.array([-0.7, 0.9, 0.9, 0.2]), np.array([0.7, 0.9, 0.9, 0.2])
STEPS, LATE = 360, 30


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Creep:
    """Goes a tenth of the way at every step."""

    privileged = False

    def init(self, observation):
        return ()

    def act(self, observation, carry, key):
        away = observation.goal_joints - observation.joint_position
        return observation.joint_position + 0.1 * away, carry


@dataclass(frozen=True)
class Dropped(Static):
    """A box that is there from one control step on."""

    name: str = "DROP"
    title: str = "a box that drops in"
    movers: int = 1

    def reset(self, problem, arm, key, episode):
        return no_movers(1), ()

    def advance(self, movers, memory, problem, arm, clock, episode):
        there = jnp.array([[0.6, 0.0, 0.45]])
        return replace(movers, position=there, active=movers.active | (clock >= LATE)), memory


@dataclass(frozen=True)
class Centres:
    """Sees the centres of the moving boxes, and nothing else."""

    points: int = 1

    def reset(self, keys, problem, movers):
        return ()

    def observe(self, state, problem, movers, robot, poses):
        return movers.position, movers.active


@pytest.fixture(scope="module")
def arm(tmp_path_factory):
    return toy_arm(tmp_path_factory.mktemp("toy"))


@pytest.fixture(scope="module")
def trace(arm):
    """A stranger's policy, arm, task and sensor together, in a scene of nothing else."""
    episode = drpbench.Episode(steps=STEPS)
    world = drpbench.World(Dropped(), arm, episode, Centres(), robot_points=16)
    position, rotation = arm.grip_pose(arm.link_poses(jnp.asarray(GOAL, jnp.float32)))
    problem = Problem(
        id=np.zeros(1, np.int32),
        level=np.zeros(1, np.int32),
        start=START[None].astype(np.float32),
        goal=GOAL[None].astype(np.float32),
        goal_position=np.asarray(position)[None],
        goal_quaternion=np.asarray(matrix_to_quaternion(rotation))[None],
        obstacles=Primitives(
            kind=np.full((1, 1), BOX, np.int32),
            half_size=np.full((1, 1, 3), 0.1, np.float32),
            position=np.zeros((1, 1, 3), np.float32),
            rotation=np.eye(3, dtype=np.float32)[None, None],
            mask=np.zeros((1, 1), bool),
        ),
    )
    assert isinstance(Creep(), drpbench.Policy) and isinstance(Centres(), drpbench.Sensor)
    return drpbench.Rollout(world, Creep(), lanes=1).run(problem)


def test_an_arm_a_task_and_a_sensor_make_a_world(trace, arm):
    assert trace.joint_position.shape == (STEPS, 1, arm.joints)
    assert not trace.mover_active[: LATE - 1].any() and trace.mover_active[LATE:].all()
    assert trace.world.spec["scene_points"].shape == (1, 3)


def test_its_episode_is_judged_like_any_other(trace, arm):
    (row,) = rows([0], ["none"], trace)
    assert row.task == "DROP" and row.reached and row.status == "ok"
    # The box stands half way, where the forearm comes by.
    assert row.collided and row.first_collision_step >= LATE
    assert row.first_collision_link in arm.link_names


def test_a_problem_set_is_a_file_and_may_be_for_a_strangers_arm(tmp_path, arm, monkeypatch):
    monkeypatch.setitem(ARMS, "toy", lambda finger_opening=0.0: arm)
    ball = {"shape": "sphere", "radius": 0.05, "position": [0.6, 0.6, 0.05]}
    lines = [
        {"format": "drpbench-problems-1", "name": "theirs", "arm": "toy", "tasks": ["SE"]},
        {"task": "SE", "start": START.tolist(), "goal": GOAL.tolist(), "obstacles": [ball]},
        {"task": "SE", "start": GOAL.tolist(), "goal": START.tolist(), "obstacles": []},
    ]
    path = tmp_path / "theirs.jsonl"
    path.write_text("".join(json.dumps(line) + "\n" for line in lines))
    found = drpbench.evaluate(Creep(), path, progress=False, out=tmp_path / "theirs.json.gz")
    assert found.header.problem_set == "theirs" and found.header.policy == "Creep"
    assert [row["success"] for row in found.to_dicts()] == [True, True]
    assert "2/2" in found.summary()
    assert len(found.to_pandas()) == 2
