"""The world and the policies with another arm than the Panda, and with another clock."""

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest

from drpbench.compile import jit
from drpbench.contract import REACH_POSITION, Episode, Problem
from drpbench.envs import TASKS, World
from drpbench.geometry import BOX, Primitives, matrix_to_quaternion
from drpbench.perception import SurfaceCloud
from drpbench.plugins.registry import choose

from ..toy_arm import toy_arm

pytestmark = pytest.mark.slow

NAMES = ("straight", "rmp", "straight+dcp-rmp")
CLOCK = Episode(steps=360)
OTHER_CLOCK = Episode(steps=100, period=1.0 / 30.0)
POINTS, ROBOT_POINTS = 500, 80
START, GOAL = np.array([-0.7, 0.9, 0.9, 0.2]), np.array([0.7, 0.9, 0.9, 0.2])
IN_THE_WAY = (0.6, 0.0, 0.45)  # [m] where the forearm passes half way


@pytest.fixture(scope="module")
def robot(tmp_path_factory):
    return toy_arm(tmp_path_factory.mktemp("toy"))


def problems(robot):
    """One in an empty scene, and one with a box half way."""
    position, rotation = robot.grip_pose(robot.link_poses(jnp.asarray(GOAL, jnp.float32)))
    scenes = Primitives(
        kind=np.full((2, 1), BOX, np.int32),
        half_size=np.full((2, 1, 3), 0.1, np.float32),
        position=np.tile(np.float32(IN_THE_WAY), (2, 1, 1)),
        rotation=np.tile(np.eye(3, dtype=np.float32), (2, 1, 1, 1)),
        mask=np.array([[False], [True]]),
    )
    both = jax.tree.map(
        lambda leaf: np.stack([np.asarray(leaf, np.float32)] * 2),
        (START, GOAL, position, matrix_to_quaternion(rotation)),
    )
    return Problem(np.arange(2, dtype=np.int32), np.ones(2, np.int32), *both, scenes)


def episodes(world, policies):
    """Every policy in both scenes, all arms in one program: last joints (policy, scene, 4) and
    events by name (steps, policy, scene, ...)."""

    def run(problems):
        def ask(seen, carries, clock):
            answers = [
                jax.vmap(policy.act, in_axes=(0, 0, None))(some, carry, jax.random.key(0))
                for policy, some, carry in zip(policies, seen, carries, strict=True)
            ]
            return jnp.concatenate([target for target, _ in answers]), [c for _, c in answers]

        def observed(states):
            seen = jax.vmap(world.observe)(states)
            return [
                jax.tree.map(lambda leaf, i=i: leaf[2 * i : 2 * i + 2], seen)
                for i in range(len(policies))
            ]

        def step(now, clock):
            states, carries = now
            targets, carries = ask(observed(states), carries, clock)
            states, events = jax.vmap(world.step, in_axes=(0, 0, None))(states, targets, clock)
            return (states, carries), events

        problems = jax.tree.map(lambda leaf: jnp.concatenate([leaf] * len(policies)), problems)
        states = jax.vmap(lambda p: world.reset(p, jax.random.key(0)))(problems)
        carries = [
            jax.vmap(policy.init)(seen)
            for policy, seen in zip(policies, observed(states), strict=True)
        ]
        clocks = jnp.arange(world.episode.steps, dtype=jnp.int32)
        (states, _), events = jax.lax.scan(step, (states, carries), clocks)
        return states, events

    states, events = jit(run)(problems(world.robot))
    shape = (len(policies), 2)
    return (
        np.asarray(states.joint_position).reshape(*shape, -1),
        {
            name: np.asarray(leaf).reshape(len(leaf), *shape, *leaf.shape[2:])
            for name, leaf in vars(events).items()
        },
    )


@pytest.fixture(scope="module")
def run(robot):
    world = World(TASKS["SE"], robot, CLOCK, SurfaceCloud(POINTS), ROBOT_POINTS)
    return episodes(world, [choose(name, robot=robot, episode=CLOCK).policy for name in NAMES])


def test_the_toys_frames_are_those_of_its_model(robot):
    model = robot.spec().compile()
    data = mujoco.MjData(model)
    rng = np.random.default_rng(0)
    for q in rng.uniform(robot.joint_lower, robot.joint_upper, (5, 4)):
        data.qpos = q
        mujoco.mj_kinematics(model, data)
        poses = robot.link_poses(jnp.asarray(q, jnp.float32))
        bodies = [model.body(name).id for name in robot.link_names]
        np.testing.assert_allclose(poses.position, data.xpos[bodies], atol=1e-6)
        np.testing.assert_allclose(poses.rotation, data.xmat[bodies].reshape(-1, 3, 3), atol=1e-6)


def test_every_policy_reaches_its_goal_in_an_empty_scene(robot, run):
    _, events = run
    assert events["finite"].all()
    goal = robot.grip_pose(robot.link_poses(jnp.asarray(GOAL, jnp.float32)))[0]
    away = np.linalg.norm(events["grip_position"][-1, :, 0] - np.asarray(goal), axis=-1)
    assert dict(zip(NAMES, away < REACH_POSITION, strict=True)) == dict.fromkeys(NAMES, True)
    assert events["clearance"][:, :, 0].min() > 1.0


def test_a_box_in_the_way_is_hit_blindly_and_seen_by_rmp(run):
    joints, events = run
    lowest = dict(zip(NAMES, events["clearance"][:, :, 1].min(axis=0), strict=True))
    assert -0.03 < lowest["straight"] < 0.0  # it is stopped, not run through
    assert lowest["straight+dcp-rmp"] < 0.0  # which reacts to what moves only
    assert lowest["rmp"] > 0.0
    turned = joints[:, 1, 0]
    assert turned[NAMES.index("straight")] < 0.0 < GOAL[0]


def test_another_clock_drives_the_same_arm_to_the_same_goal(robot):
    world = World(TASKS["SE"], robot, OTHER_CLOCK, SurfaceCloud(POINTS), ROBOT_POINTS)
    policy = choose("straight", robot=robot, episode=OTHER_CLOCK).policy
    joints, events = episodes(world, [policy])
    assert events["finite"].shape[0] == OTHER_CLOCK.steps and events["finite"].all()
    np.testing.assert_allclose(joints[0, 0], GOAL, atol=0.02)
    # At 1 rad/s, half the velocity limit, the way of 1.4 rad takes 1.4 s, whatever the clock.
    left = np.linalg.norm(
        events["grip_position"][:, 0, 0] - events["grip_position"][-1, 0, 0], axis=-1
    )
    assert 1.2 < np.argmax(left < 0.1) * OTHER_CLOCK.period < 2.0
    assert events["clearance"][:, 0, 1].min() < 0.0


def test_worlds_of_the_same_values_are_one_value(robot, tmp_path):
    world = World(TASKS["SE"], robot, CLOCK, SurfaceCloud(POINTS))
    assert world == World(TASKS["SE"], robot, CLOCK, SurfaceCloud(POINTS))
    assert hash(world) == hash(World(TASKS["SE"], robot, CLOCK, SurfaceCloud(POINTS)))
    for other in (
        World(TASKS["SE"], toy_arm(tmp_path), CLOCK, SurfaceCloud(POINTS)),
        World(TASKS["SE"], robot, OTHER_CLOCK, SurfaceCloud(POINTS)),
        World(TASKS["SE"], robot, CLOCK, SurfaceCloud(POINTS + 1)),
        World(TASKS["FDO"], robot, CLOCK, SurfaceCloud(POINTS)),
    ):
        assert world != other
