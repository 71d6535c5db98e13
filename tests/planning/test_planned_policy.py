"""A planner as a policy: it plans in `init` and follows its path in `act`."""

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from drpbench.contract import Policy
from drpbench.envs import TASKS, World
from drpbench.planning.expert import PlannerSettings, plan
from drpbench.planning.rrt_connect import Planner
from drpbench.problems import load_set
from drpbench.rollout import Rollout

SETTINGS = PlannerSettings(iterations=12, vias=7)
PACE = 12  # control steps from one waypoint to the next
PROBLEMS = [1, 2]  # of SE; straight lines collide there


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Planned:
    """Plans once among the obstacles that it is told of; stands still where it finds no path."""

    privileged = True

    def init(self, seen):
        key = jax.random.key(0)
        found = plan(seen.obstacles, seen.joint_position, seen.goal_joints, key, settings=SETTINGS)
        return jnp.where(found.success, found.path, seen.joint_position), jnp.int32(0)

    def act(self, observation, carry, key):
        path, step = carry
        return path[jnp.minimum(step // PACE, len(path) - 1)], (path, step + 1)


@pytest.mark.slow
def test_a_policy_may_plan_and_goes_round_what_is_in_the_way(spheres):
    assert isinstance(Planned(), Policy)
    numbered = load_set().task("SE")
    problems = numbered.take(PROBLEMS)
    for index, start, goal in zip(PROBLEMS, problems.start, problems.goal, strict=True):
        spheres.set_obstacles(numbered.obstacles[index])
        assert not Planner(spheres, 0.0).straight(start.astype(float), goal.astype(float))
    trace = Rollout(World(TASKS["SE"]), Planned(), lanes=len(PROBLEMS)).run(problems)
    assert np.all(trace.clearance.min(axis=0) > 0.0)
    assert np.all(trace.position_error[-1] < 0.01)
