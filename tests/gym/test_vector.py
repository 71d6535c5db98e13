"""Many problems at once: spaces, order, clock, and the same verdict as `drpbench run`'s."""

import gymnasium
import jax
import numpy as np
import pytest
from gymnasium.utils import env_checker
from gymnasium.vector import AutoresetMode

import drpbench.gym  # noqa: F401 - registers the environments
from drpbench.contract import EPISODE, Episode, Observation
from drpbench.plugins.registry import choose
from drpbench.problems import load_set
from drpbench.results import load
from drpbench.results.shipped import shipped_results
from drpbench.robot import PANDA

from .snippets import snippet

pytestmark = pytest.mark.slow

LANES = 4


@pytest.fixture(scope="module")
def envs():
    return gymnasium.make_vec("drpbench/FDO-v1", num_envs=LANES)


def driven(envs, ids=None, policy="straight"):
    """The outcome of an episode of a policy that carries nothing, and where each lane first
    collided."""
    policy = choose(policy).policy
    act = jax.jit(jax.vmap(lambda seen: policy.act(Observation(**seen), (), None)[0]))
    observation, info = envs.reset(options=None if ids is None else {"id": ids})
    rewards = np.zeros(envs.num_envs)
    first_collision = np.full(envs.num_envs, -1)
    for step in range(EPISODE.steps):
        observation, reward, terminated, truncated, info = envs.step(act(observation))
        rewards += reward
        first_collision[(first_collision < 0) & info["collided"]] = step
        assert not terminated.any()
        assert truncated.all() == truncated.any() == (step == EPISODE.steps - 1)
    return observation, rewards, first_collision, info


def shipped(task, wanted, policy="straight"):
    """Rows of `drpbench run --policy straight`, `wanted` of each verdict, none of them by a
    hair."""
    rows = load(shipped_results() / f"{policy}.json.gz").rows
    clear = [
        row for row in rows if row.task == task and row.valid and abs(row.min_clearance) > 0.01
    ]
    solved = [row for row in clear if row.success][:wanted]
    failed = [row for row in clear if not row.success][:wanted]
    assert len(solved) == len(failed) == wanted
    return solved + failed


def same_outcome(rows, driven):
    """Whether an episode came out as the rows of the benchmark say."""
    _, returns, first_collision, info = driven
    assert info["id"].tolist() == [row.id for row in rows]
    assert returns.tolist() == [row.success for row in rows]
    assert info["reached"].tolist() == [row.reached for row in rows]
    assert info["collided"].tolist() == [row.collided for row in rows]
    assert info["valid"].all() and info["finite"].all()
    steps = [-1 if row.first_collision_step is None else row.first_collision_step for row in rows]
    np.testing.assert_allclose(first_collision, steps, atol=1)
    for name, bound in (("position_error", 1e-3), ("orientation_error", 1e-2)):
        away = np.abs(info[name] - [getattr(row, name) for row in rows])
        assert (away < np.where(info["collided"], 10 * bound, bound)).all()  # contacts amplify


def test_an_episode_has_the_verdict_of_the_benchmark(envs):
    rows = shipped("FDO", LANES // 2)
    outcome = driven(envs, [row.id for row in rows])
    same_outcome(rows, outcome)
    assert outcome[0] in envs.observation_space


# The straight line solves no GB: its goal is blocked.
@pytest.mark.parametrize(
    ("task", "policy"), [("SE", "straight"), ("GB", "rmp"), ("DGB", "straight")]
)
def test_so_it_has_in_the_other_tasks(task, policy):
    rows = shipped(task, 1, policy)
    envs = gymnasium.make_vec(f"drpbench/{task}-v1", num_envs=2)
    same_outcome(rows, driven(envs, [row.id for row in rows], policy))


def test_a_step_after_the_last_one_is_refused_until_a_reset():
    short = Episode(steps=2)
    envs = gymnasium.make_vec("drpbench/SE-v1", num_envs=LANES, episode=short)
    observation, _ = envs.reset(seed=0)
    for last in (False, True):
        *_, truncated, _ = envs.step(observation["joint_position"])
        assert truncated.tolist() == [last] * LANES
    with pytest.raises(RuntimeError, match=r"reset\(\)"):
        envs.step(observation["joint_position"])
    envs.reset(options={"reset_mask": truncated})
    envs.step(observation["joint_position"])


def test_problems_come_once_each_in_an_order_that_the_seed_sets(envs):
    def served(seed, rounds):
        ids = [envs.reset(seed=seed)[1]["id"]]
        return np.concatenate(ids + [envs.reset()[1]["id"] for _ in range(rounds - 1)]).tolist()

    count = load_set().task("FDO").count
    every = served(5, count // LANES)
    assert sorted(every) == list(range(count))
    assert served(5, 3) == every[: 3 * LANES]
    assert served(6, 3) != every[: 3 * LANES]


def test_a_numbered_problem_is_the_same_in_any_lane_whatever_the_seed(envs):
    one, _ = envs.reset(seed=1, options={"id": [17, 3, 4, 5]})
    two, info = envs.reset(seed=2, options={"id": np.array([9, 9, 9, 17])})
    assert info["id"].tolist() == [9, 9, 9, 17]
    for name, values in one.items():
        np.testing.assert_array_equal(values[0], two[name][3], err_msg=name)
    np.testing.assert_array_equal(one["goal_joints"][0], load_set().task("FDO").goal[17])


def test_a_target_that_is_no_number_fails_its_lane_alone(envs):
    observation, _ = envs.reset(options={"id": [0, 1, 2, 3]})
    targets = np.tile(PANDA.home, (LANES, 1))
    targets[1, 4] = np.nan
    envs.step(targets)
    *_, info = envs.step(observation["goal_joints"])
    assert info["finite"].tolist() == [True, False, True, True]
    assert not info["reached"][1]


def test_arrays_are_the_callers_own(envs):
    observation, info = envs.reset(options={"id": [0, 1, 2, 3]})
    before = {name: values.copy() for name, values in observation.items()}
    observation["goal_joints"] += 1.0
    observation["scene_points"] *= 0.0
    info["id"][:] = 9
    after, *_, info = envs.step(before["goal_joints"])
    np.testing.assert_array_equal(after["goal_joints"], before["goal_joints"])
    assert after["scene_points"].any() and info["id"].tolist() == [0, 1, 2, 3]


@pytest.mark.parametrize(
    "check", [env_checker.check_reset_seed_determinism, env_checker.check_reset_options]
)
def test_gymnasiums_checks_of_resets_hold_for_many(envs, check):
    # Gymnasium has no checker of vector environments; these two ask nothing that one does not have.
    check(envs)


def test_the_same_seed_and_actions_give_the_same_steps_in_fresh_arrays(envs):
    def episode():
        envs.action_space.seed(3)
        returned = [envs.reset(seed=3)]
        for _ in range(4):
            *outcome, info = envs.step(envs.action_space.sample())
            assert outcome[0] in envs.observation_space
            assert [part.dtype for part in outcome[1:]] == [np.float64, np.bool_, np.bool_]
            returned.append((*outcome, info))
        return jax.tree.leaves(returned)

    one, two = episode(), episode()
    assert len({id(leaf) for leaf in one}) == len(one)
    for left, right in zip(one, two, strict=True):
        np.testing.assert_array_equal(left, right)
        assert not np.shares_memory(left, right)


def test_infos_say_which_lanes_have_them(envs):
    *_, info = envs.step(np.tile(PANDA.home, (LANES, 1)))
    names = {name for name in info if not name.startswith("_")}
    assert {"id", "clearance", "reached", "collided", "valid"} <= names
    assert {name for name in info if name.startswith("_")} == {f"_{name}" for name in names}
    assert all(info[f"_{name}"].all() and len(info[name]) == LANES for name in names)


def test_nothing_resets_by_itself(envs):
    assert envs.metadata["autoreset_mode"] is AutoresetMode.DISABLED


@pytest.mark.parametrize(
    ("options", "told"),
    [
        ({"id": [0, 1, 2, 100000]}, "no problem 100000 in FDO; ids go from 0 to 199"),
        ({"id": [0, 1, 2, -1]}, "no problem -1"),
        ({"id": [0, 1, 2]}, "4 whole numbers"),
        ({"id": [0.5, 1, 2, 3]}, "4 whole numbers"),
        ({"id": 3}, "4 whole numbers"),
        ({"ids": [0]}, "no option 'ids'; there are: id, reset_mask"),
        ({"reset_mask": [True, False, True, True]}, "end together"),
    ],
)
def test_wrong_options_are_named(envs, options, told):
    with pytest.raises(ValueError, match=told) as refused:
        envs.reset(options=options)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        ({"num_envs": 0}, "num_envs=0"),
        ({"problems": "mine"}, "frozen, training"),
        ({"task": "XYZ"}, "there are: SE, SAO"),
        ({"run_seed": 2**31}, "32 bits"),
    ],
)
def test_wrong_arguments_are_named(arguments, told):
    with pytest.raises(ValueError, match=told):
        gymnasium.make_vec("drpbench/FDO-v1", **arguments)


def test_wrong_actions_are_named(envs):
    with pytest.raises(ValueError, match=r"shape \(7,\), not \(4, 7\)"):
        envs.step(PANDA.home)


def test_the_snippet_of_the_documentation_runs(capsys):
    names = snippet("envs.reset(seed=0)")
    assert names["info"]["id"].shape == (LANES,) and not names["truncated"].any()
    assert capsys.readouterr().out


SHORT = Episode(steps=3)


@pytest.fixture(scope="module")
def restarting():
    """Of each mode the same four steps, and what each of them gave."""
    found = {}
    for mode in ("NextStep", AutoresetMode.SAME_STEP):
        envs = drpbench.gym.VectorEnv(2, task="SE", episode=SHORT, autoreset_mode=mode)
        first, info = envs.reset(seed=3)
        steps = [envs.step(first["joint_position"]) for _ in range(4)]
        found[envs.metadata["autoreset_mode"]] = [(first, None, None, None, info), *steps]
    return found


def test_the_next_step_begins_the_next_episodes(restarting):
    begun, *steps = restarting[AutoresetMode.NEXT_STEP]
    assert [step[3].all() for step in steps] == [False, False, True, False]
    observation, reward, _, _, info = steps[-1]
    assert not reward.any() and not set(info["id"]) & set(begun[4]["id"])
    assert (observation["goal_joints"] != begun[0]["goal_joints"]).any()
    assert set(steps[2][4]["id"]) == set(begun[4]["id"]) and "clearance" not in info


def test_the_last_step_itself_begins_the_next_episodes(restarting):
    begun, *steps = restarting[AutoresetMode.SAME_STEP]
    _, *others = restarting[AutoresetMode.NEXT_STEP]
    assert [step[3].all() for step in steps] == [False, False, True, False]
    shown, _, _, _, info = steps[2]
    np.testing.assert_array_equal(shown["goal_joints"], others[3][0]["goal_joints"])
    assert not set(info["id"]) & set(begun[4]["id"]) and "clearance" not in info
    assert info["final_info"]["id"].tolist() == begun[4]["id"].tolist()
    assert info["_final_obs"].all() and "clearance" in info["final_info"]
    for lane, final in enumerate(info["final_obs"]):
        np.testing.assert_array_equal(final["joint_position"], others[2][0]["joint_position"][lane])


def test_another_mode_is_refused():
    with pytest.raises(ValueError, match="autoreset_mode='often': expected one of 'NextStep'"):
        drpbench.gym.VectorEnv(2, task="SE", autoreset_mode="often")


def test_normalised_observations_are_shares_of_what_the_arm_can_do():
    def make():
        return drpbench.gym.VectorEnv(2, task="SE", episode=SHORT, autoreset_mode="SameStep")

    plain, envs = make(), drpbench.gym.NormalisedVectorObservations(make())
    raw, _ = plain.reset(seed=1)
    seen, _ = envs.reset(seed=1)
    assert seen in envs.observation_space
    share = (raw["joint_position"] - PANDA.joint_lower) / (PANDA.joint_upper - PANDA.joint_lower)
    np.testing.assert_allclose(seen["joint_position"], 2 * share - 1, atol=1e-6)
    np.testing.assert_array_equal(seen["scene_points"], raw["scene_points"])
    for _ in range(SHORT.steps):
        targets = raw["goal_joints"]
        raw, *_, info = plain.step(targets)
        seen, *_, found = envs.step(targets)
    for one, other in zip(info["final_obs"], found["final_obs"], strict=True):
        np.testing.assert_allclose(
            other["joint_velocity"], one["joint_velocity"] / PANDA.velocity_limit, rtol=1e-5
        )


def test_one_environment_is_normalised_alike():
    env = drpbench.gym.NormalisedObservations(gymnasium.make("drpbench/SE-v1"))
    seen, _ = env.reset(seed=1)
    assert seen in env.observation_space and np.abs(seen["goal_joints"]).max() <= 1.0
