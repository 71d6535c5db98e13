"""A policy that is kept out of the scorer's process cannot score itself."""

import subprocess
import sys

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from drpbench.evaluation import Request, run
from drpbench.evaluation.progress import Silent
from drpbench.evaluation.verification import verify
from drpbench.plugins.errors import PolicyError
from drpbench.plugins.isolation import is_ours, isolated
from drpbench.plugins.registry import choose
from drpbench.results import load
from drpbench.robot import PANDA

from ..few_lanes import DRPBENCH
from ..scenes import observation

CHEAT = '''
import importlib

scorer = importlib.import_module("drpbench.evaluation.run")
honest = scorer.rows_of
SOLVED = dict(
    success=True, reached=True, reached_5cm=True, reached_once=True, collided=False,
    first_collision_step=None, first_collision_link=None, time_to_goal=1.0, min_clearance=0.02,
    position_error=0.001, orientation_error=0.001,
)
scorer.rows_of = lambda *given: [row.model_copy(update=SOLVED) for row in honest(*given)]


class Cheat:
    """Holds still, and calls that a success."""

    def __init__(self, gain: float = 1.0):
        self.gain = gain

    def reset(self, observation):
        pass

    def act(self, observation):
        return observation.joint_position
'''


@pytest.mark.parametrize(
    ("name", "ours"),
    [
        ("straight", True),
        ("straight+dcp-rmp", True),
        ("impact:mine.safetensors", True),
        ("mine.safetensors", True),
        ("my.module:MyPolicy", False),
        ("my.module:MyLearner:mine.safetensors", False),
        ("an-installed-one", False),
    ],
)
def test_whose_code_a_policy_is(name, ours):
    assert is_ours(name) == ours


@pytest.mark.slow
def test_a_policy_that_replaces_the_score_is_found_out(tmp_path, monkeypatch):
    (tmp_path / "cheat.py").write_text(CHEAT)
    monkeypatch.chdir(tmp_path)
    command = [*DRPBENCH, "run", "--task", "FDO", "--problems", "2"]
    command += ["--policy", "cheat:Cheat", "--policy-arg", "gain=2", "--out", "x.json"]
    subprocess.run(command, check=True, capture_output=True)
    claimed = load("x.json")
    assert all(row.success for row in claimed.rows)
    found = verify("x.json", claimed, 2, 0, Silent())
    assert not found.reproduced and len({(d.task, d.id) for d in found.turned}) == 2
    assert "cheat" not in sys.modules
    # With the policy in this process the claim would stand: that is what the child is for.
    again = subprocess.run([*command[:-1], "y.json"], check=True, capture_output=True, text=True)
    assert "2 rows in y.json" in again.stdout
    assert [row.success for row in load("y.json").rows] == [True, True]


CHATTY = """
import sys


class Chatty:
    about = "says much"

    def reset(self, observation):
        pass

    def act(self, observation):
        print("x" * 100_000, file=sys.stderr)  # more than a pipe holds
        return observation.joint_position
"""


@pytest.mark.slow
def test_a_policy_may_print_as_much_as_it_likes(tmp_path, monkeypatch, capfd):
    (tmp_path / "chatty.py").write_text(CHATTY)
    monkeypatch.chdir(tmp_path)
    seen = jax.tree.map(lambda leaf: leaf[None], observation(PANDA.home, PANDA.home))
    with isolated("chatty:Chatty", time_limit=20.0) as choice:
        assert choice.policy.about == "says much"
        choice.policy.reset(seen, 1)
        np.testing.assert_array_equal(choice.policy.act(seen, 1), seen.joint_position)
    assert "x" * 100_000 in capfd.readouterr().err


@pytest.mark.slow
def test_an_isolated_run_is_the_same_run(tmp_path):
    request = Request(
        policy="straight", problems={"FDO": [0, 1]}, out=tmp_path / "a.json", isolated=True
    )
    alone = run(request, Silent())
    beside = run(
        Request(policy="straight", problems={"FDO": [0, 1]}, out=tmp_path / "b.json"), Silent()
    )
    assert alone.header.isolated and not beside.header.isolated
    assert alone.header.policy_parameters == beside.header.policy_parameters
    for a, b in zip(alone.rows, beside.rows, strict=True):
        assert (a.success, a.collided, a.reached) == (b.success, b.collided, b.reached)
        np.testing.assert_allclose(a.position_error, b.position_error, atol=1e-3)


@pytest.mark.slow
def test_what_stands_over_it_is_the_scorers_and_parameters_are_the_same():
    for name in ("straight+dcp-rmp",):
        with isolated(name, ["speed=0.3"]) as choice:
            assert choice.parameters == choose(name, ["speed=0.3"]).parameters


GIVES_UP = """
class GivesUp:
    def reset(self, observation):
        self.failures = ["no way", ""]

    def act(self, observation):
        return observation.joint_position
"""


@pytest.mark.slow
def test_what_it_gives_up_is_told_through_the_wall(tmp_path, monkeypatch):
    (tmp_path / "tired.py").write_text(GIVES_UP)
    monkeypatch.chdir(tmp_path)
    with isolated("tired:GivesUp") as choice:
        one = observation(PANDA.home, PANDA.home)
        seen = jax.tree.map(lambda leaf: jnp.stack([leaf, leaf]), one)
        choice.policy.reset(seen, 2)
        assert choice.policy.failures(2) == ("no way", "")


@pytest.mark.slow
def test_what_cannot_be_made_is_one_line():
    with pytest.raises(PolicyError, match="no module") as caught, isolated("nowhere.at:All"):
        pass
    assert "\n" not in str(caught.value)
    with pytest.raises(PolicyError, match="already"), isolated("remote:127.0.0.1:1"):
        pass
