"""One environment, as Gymnasium's own checkers see it."""

import importlib.util
import subprocess
import sys
import warnings

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import drpbench.gym
from drpbench.contract import Episode
from drpbench.envs import TASKS

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def env():
    return gymnasium.make("drpbench/FDO-v1")


def test_gymnasiums_checker_finds_nothing_but_the_scale_of_actions(env):
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        check_env(env.unwrapped)
    # Targets are joint positions [rad]; whoever wants [-1, 1] puts RescaleAction over them.
    assert all("symmetric and normalized" in str(one.message) for one in told), told


def test_rescaled_actions_are_the_joint_range(env):
    rescaled = gymnasium.wrappers.RescaleAction(env, np.float32(-1.0), np.float32(1.0))
    rescaled.reset(options={"id": 3})
    moved, *_ = rescaled.step(np.zeros(7, np.float32))
    env.reset(options={"id": 3})
    middle = (env.action_space.low + env.action_space.high) / 2
    expected, *_ = env.step(middle.astype(np.float32))
    np.testing.assert_allclose(moved["joint_position"], expected["joint_position"], atol=1e-6)


def test_every_task_is_registered():
    assert tuple(f"drpbench/{task}-v1" for task in TASKS) == drpbench.gym.IDS
    for id, task in zip(drpbench.gym.IDS, TASKS, strict=True):
        assert gymnasium.spec(id).kwargs == {"task": task}
        assert gymnasium.make(id).unwrapped.action_space.shape == (7,)


def test_values_are_plain(env):
    _, info = env.reset(options={"id": 17})
    assert info == {"id": 17}
    _, reward, terminated, truncated, info = env.step(env.action_space.sample())
    assert (reward, terminated, truncated) == (0.0, False, False)
    assert {type(value) for value in info.values()} == {bool, float, int}


def test_a_wrong_shape_is_named(env):
    env.reset(options={"id": 0})
    with pytest.raises(ValueError, match=r"shape \(6,\), not \(7,\)"):
        env.unwrapped.step(np.zeros(6))


def test_without_gymnasium_the_extra_is_named():
    code = "import sys; sys.modules['gymnasium'] = None; import drpbench.gym"
    shown = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert shown.returncode == 1
    last = shown.stderr.strip().splitlines()[-1]
    assert last == "ImportError: drpbench.gym needs Gymnasium: pip install 'drpbench[gym]'"


def test_it_draws_what_is_there(tmp_path):
    with pytest.raises(ValueError, match="expected 'rgb_array' or None"):
        drpbench.gym.SingleEnv(task="FDO", render_mode="human")
    env = gymnasium.make("drpbench/FDO-v1", render_mode="rgb_array")
    assert env.metadata["render_modes"] == ["rgb_array"]
    env = gymnasium.wrappers.RecordVideo(env, str(tmp_path)) if _films() else env
    observation, _ = env.reset(options={"id": 3})
    before = env.render() if not _films() else env.unwrapped.render()
    assert before.shape == (480, 640, 3) and before.dtype == np.uint8 and before.std() > 10
    for _ in range(20):
        env.step(observation["goal_joints"])
    after = env.unwrapped.render()
    assert (np.abs(after.astype(int) - before).max(axis=-1) > 30).mean() > 0.005  # the arm moved
    env.close()
    assert not _films() or any(tmp_path.glob("*.mp4"))


def _films():
    """Whether RecordVideo's own dependency is here."""
    return importlib.util.find_spec("moviepy") is not None


def test_a_forked_process_is_told_what_to_use_instead():
    envs = gymnasium.make_vec("drpbench/FDO-v1", num_envs=1, vectorization_mode="async")
    with pytest.raises(RuntimeError, match="expected gymnasium.make_vec"):
        envs.reset()
    envs.close(terminate=True)


def test_the_dense_return_is_what_came_nearer_less_collisions_plus_success():
    with pytest.raises(ValueError, match="reward='thick': expected 'sparse' or 'dense'"):
        drpbench.gym.SingleEnv(task="FDO", reward="thick")
    episode = Episode(steps=200)
    env = drpbench.gym.SingleEnv(task="FDO", reward="dense", control_mode="delta", episode=episode)
    observation, _ = env.reset(options={"id": 3})
    assert env.action_space.low.tolist() == [-1.0] * 7
    total, first, start = 0.0, None, observation["joint_position"]
    for step in range(episode.steps):
        away = observation["goal_joints"] - observation["joint_position"]
        observation, reward, _, _, info = env.step(np.sign(away) * 0.5)
        first = info if first is None else first
        total += reward
        if step == 20:  # half of the velocity limits, once the servos are up to it
            moved = np.abs(observation["joint_velocity"]).max()
            assert moved == pytest.approx(0.5 * 2.175, rel=0.3)
    assert np.abs(observation["joint_position"] - start).max() > 0.3
    error = info["position_error"] + 0.1 * info["orientation_error"]
    began = total + error + info["collided"] - (info["reached"] and not info["collided"])
    near = first["position_error"] + 0.1 * first["orientation_error"]
    assert began == pytest.approx(near, abs=0.02)  # one step later than it began
