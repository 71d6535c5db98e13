"""stable-baselines3 on the environments: episodes end as it expects, and the example learns."""

import importlib
import sys

import gymnasium
import numpy as np
import pytest

import drpbench.gym  # noqa: F401 - registers the environments
from drpbench.contract import Episode

pytest.importorskip(
    "stable_baselines3", reason="stable-baselines3 is not installed (drpbench[sb3])"
)
from drpbench.gym.stable_baselines import StableBaselinesVecEnv

pytestmark = pytest.mark.slow

LANES, STEPS = 2, 6


def made(**settings):
    return gymnasium.make_vec(
        "drpbench/FDO-v1",
        num_envs=LANES,
        episode=Episode(steps=STEPS),
        **{"autoreset_mode": "SameStep"} | settings,
    )


def test_an_episode_ends_as_stable_baselines_expects():
    lanes, plain = StableBaselinesVecEnv(made()), made(autoreset_mode="Disabled")
    lanes.seed(3)
    lanes.set_options({"id": [5, 7]})
    first = lanes.reset()
    begun, _ = plain.reset(options={"id": [5, 7]})
    np.testing.assert_array_equal(first["joint_position"], begun["joint_position"])
    assert [info["id"] for info in lanes.reset_infos] == [5, 7]
    actions = first["goal_joints"]
    for step in range(STEPS):
        observation, rewards, dones, infos = lanes.step(actions)
        expected, _, _, _, info = plain.step(actions)
        assert rewards.dtype == np.float32 and dones.tolist() == [step == STEPS - 1] * LANES
        for lane in range(LANES):
            assert infos[lane]["id"] == (5, 7)[lane]
            assert infos[lane]["clearance"] == pytest.approx(info["clearance"][lane], abs=1e-6)
            assert ("terminal_observation" in infos[lane]) == (step == STEPS - 1)
    for lane in range(LANES):
        ended = infos[lane]["terminal_observation"]
        np.testing.assert_array_equal(ended["joint_position"], expected["joint_position"][lane])
        assert infos[lane]["TimeLimit.truncated"] is True
        assert infos[lane]["is_success"] is False
    assert not np.array_equal(observation["joint_position"], expected["joint_position"])
    assert [info["id"] for info in infos] == [5, 7]  # of what ended, not of what begins


def test_another_way_to_begin_episodes_is_refused():
    with pytest.raises(ValueError, match="autoreset_mode='SameStep'.*got 'Disabled'") as error:
        StableBaselinesVecEnv(made(autoreset_mode="Disabled"))
    assert "\n" not in str(error.value)


def test_the_example_trains_and_what_it_learned_acts(tmp_path, monkeypatch, capsys):
    """Its first updates, on few lanes; the network then acts as a policy of the benchmark."""
    from drpbench import evaluate

    example = importlib.import_module("examples.train_ppo")
    out = tmp_path / "ppo.zip"
    arguments = ["--steps", "1", "--lanes", "4", "--problems", "4", "--out", str(out)]
    monkeypatch.setattr(sys, "argv", ["train_ppo.py", *arguments])
    example.main()
    assert "success_rate" in capsys.readouterr().out
    found = evaluate(example.Trained(str(out)), "FDO", problems=2)
    assert len(found.rows) == 2 and all(row.status == "ok" for row in found.rows)
