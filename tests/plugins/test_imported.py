"""Policies by import path and by entry point; what is none says why, in one line."""

import sys

import pytest

from drpbench.contract import Episode
from drpbench.plugins.errors import PolicyError, UnknownPolicy
from drpbench.plugins.registry import choose
from drpbench.policies import DcpRmp
from drpbench.robot import PANDA

MODULE = """
from dataclasses import dataclass
import jax, jax.numpy as jnp

limit = 3

@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Fine:
    speed: float = 0.5
    privileged = False
    def init(self, observation): return ()
    def act(self, observation, carry, key): return observation.goal_joints * self.speed, carry

class NoAct:
    def reset(self, observation): pass
class NoInit:
    def act(self, observation): pass
class Neither: pass
class Asks:
    def __init__(self, robot, control_period=1.0, gain=2.0):
        self.asked = robot, control_period
    def reset(self, observation): pass
    def act(self, observation): return observation.joint_position
class Raises:
    def __init__(self): raise RuntimeError("no weights here")
class Loose(Fine.__bases__[0]):
    privileged = False
    def init(self, observation): return ()
    def act(self, observation, carry, key): return observation.goal_joints, carry
@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Unmarked:
    def init(self, observation): return ()
    def act(self, observation, carry, key): return observation.goal_joints, carry
class Six(Fine):
    def act(self, observation, carry, key): return observation.goal_joints[:6], carry
class Bare(Fine):
    def act(self, observation, carry, key): return observation.goal_joints
class Grows(Fine):
    def act(self, observation, carry, key): return observation.goal_joints, (carry, 1.0)
class Breaks(Fine):
    def act(self, observation, carry, key): return observation.speed, carry
class Knows(Fine):
    privileged = True
    def act(self, observation, carry, key):
        return observation.goal_joints + observation.obstacles.position.sum(), carry
class Peeks(Knows):
    privileged = False
for odd in (Knows, Peeks, Six, Bare, Grows, Breaks):
    jax.tree_util.register_dataclass(odd, data_fields=["speed"], meta_fields=[])
"""


@pytest.fixture
def here(tmp_path, monkeypatch):
    """A current directory that nothing was imported from yet."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", list(sys.path))
    before = set(sys.modules)
    (tmp_path / "own_policies.py").write_text(MODULE)
    yield tmp_path
    for name in set(sys.modules) - before:
        if name.startswith("own_"):
            del sys.modules[name]


def test_an_import_path_makes_a_policy(here):
    choice = choose("own_policies:Fine", ["speed=0.25"])
    assert choice.policy.speed == 0.25 and choice.parameters == {"speed": 0.25}
    assert choose("own_policies:Knows").policy.privileged
    over = choose("own_policies:Fine+dcp-rmp")
    assert isinstance(over.policy, DcpRmp) and type(over.policy.policy) is type(choice.policy)
    assert over.parameters["policy.speed"] == 0.5 and "constants.r" in over.parameters


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("own_nothing:Fine", "no module 'own_nothing'"),
        ("own_package.policy:Fine", "no module 'own_package'"),
        ("own_policies.py:Fine", "without .py, it is a module's name"),
        ("./own_policies.py:Fine", "expected package.module:ClassName"),
        ("own_policies:Fin", "its classes: Fine, NoAct"),
        ("own_policies:", "its classes: Fine, NoAct"),
        ("own_policies:limit", "got limit of type int"),
        ("own_policies:NoAct", "no method act(observation)"),
        ("own_policies:NoInit", "no method reset(observation), or init(observation)"),
        ("own_policies:Neither", "neither reset and act"),
        ("own_policies:Raises", "RuntimeError: no weights here (own_policies.py, line "),
        ("own_policies:Loose", "register_dataclass"),
        ("own_policies:Unmarked", "privileged"),
        ("own_policies:Six", "targets of shape (6,), not (7,)"),
        ("own_policies:Bare", "act failed: ValueError"),
        ("own_policies:Grows", "a carry of another form"),
        ("own_policies:Breaks", "act failed: AttributeError"),
        ("own_policies:Peeks", "act failed: AttributeError"),
        ("own_policies:Fine+nothing", "its classes"),
    ],
)
def test_what_is_no_policy_says_why_in_one_line(here, name, said):
    with pytest.raises(PolicyError) as error:
        choose(name)
    assert said in str(error.value) and "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("source", "said"),
    [
        ("import nothing_of_the_kind", "No module named 'nothing_of_the_kind'"),
        ("def broken(:", "SyntaxError"),
        ("1 / 0", "ZeroDivisionError: division by zero (own_broken.py, line 1)"),
        ("raise SystemExit(3)", "SystemExit: 3"),
    ],
)
def test_a_module_that_cannot_be_imported_says_why(here, source, said):
    (here / "own_broken.py").write_text(source)
    with pytest.raises(PolicyError, match="importing it failed") as error:
        choose("own_broken:Fine")
    assert said in str(error.value) and "\n" not in str(error.value)


def offer(folder, value):
    """What pip leaves behind of an installed package that offers a policy."""
    info = folder / "own_package-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: own-package\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(f"[drpbench.policies]\nown-name = {value}\n")
    sys.path.insert(0, str(folder))


def test_what_asks_for_the_arm_and_the_control_period_gets_them(here):
    choice = choose("own_policies:Asks", robot=PANDA, episode=Episode(100, 0.05))
    assert choice.policy.policy.asked == (PANDA, 0.05)
    assert {key for key in choice.parameters if not key.startswith("host.")} == {"gain"}
    with pytest.raises(PolicyError, match="no such parameter; it has: gain"):
        choose("own_policies:Asks", ["control_period=1"])


def test_an_installed_package_offers_a_policy_by_name(here):
    offer(here, "own_policies:Fine")
    choice = choose("own-name+dcp-rmp", ["speed=0.25"])
    assert choice.policy.policy.speed == 0.25
    with pytest.raises(UnknownPolicy, match="own-name"):
        choose("own-nam")
    with pytest.raises(UnknownPolicy, match="'own-name' takes no file"):
        choose("own-name:x.safetensors")


def test_an_entry_point_that_leads_nowhere_says_so(here):
    offer(here, "own_policies:Gone")
    with pytest.raises(PolicyError, match="own_policies:Gone.*importing it failed"):
        choose("own-name")
