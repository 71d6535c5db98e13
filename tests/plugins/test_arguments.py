"""Parameters from the command line are read by the policy's own signature."""

from typing import Any

import pytest

from drpbench.baselines import Rmp
from drpbench.plugins.arguments import read, settings
from drpbench.plugins.errors import PolicyError
from drpbench.plugins.registry import choose
from drpbench.policies import Straight


class Mine:
    def __init__(
        self,
        path: str,
        speed: float = 0.5,
        *,
        layers: int = 2,
        soft: bool = False,
        guess=3,
        anything: Any = "x",
        either: int | str = 0,
        array: list | None = None,
    ):
        pass


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("speed=1", 1.0),
        ("speed=-2.5e-1", -0.25),
        ("layers=4", 4),
        ("soft=true", True),
        ("soft=No", False),
        ("guess=7", 7),
        ("anything=5", "5"),
        ("either=5", 5),
        ("either=five", "five"),
        ("path=a=b", "a=b"),
    ],
)
def test_values_are_read_by_annotation_or_default(text, value):
    given = [text] if text.startswith("path") else ["path=p", text]
    found = read("mine", Mine, given)[text.split("=")[0]]
    assert found == value and type(found) is type(value)


@pytest.mark.parametrize(
    ("given", "said"),
    [
        (["path=p", "sped=1"], "speed, layers, soft"),
        (["path=p", "speed=fast"], "type float"),
        (["path=p", "speed=nan"], "type float"),
        (["path=p", "layers=1.5"], "type int"),
        (["path=p", "soft=maybe"], "type bool"),
        (["path=p", "array=1"], "cannot be given"),
        (["path=p", "path=q"], "twice"),
        (["path"], "NAME=VALUE"),
        ([], "--policy-arg path=VALUE"),
    ],
)
def test_a_wrong_parameter_is_one_line(given, said):
    with pytest.raises(PolicyError) as error:
        read("mine", Mine, given)
    assert said in str(error.value) and "\n" not in str(error.value)


def test_settings_are_chosen_or_default_and_plain():
    assert settings(Mine, {"path": "p", "layers": 3}) == {
        "path": "p",
        "speed": 0.5,
        "layers": 3,
        "soft": False,
        "guess": 3,
        "anything": "x",
        "either": 0,
    }


def test_built_in_policies_take_parameters_too():
    choice = choose("straight", ["speed=0.3"])
    assert choice.policy == Straight(0.3) and choice.parameters == {"speed": 0.3}
    assert choose("rmp", ["k_g=10", "r=0.2"]).policy == Rmp(k_g=10.0, r=0.2)
    over = choose("straight+dcp-rmp", ["speed=0.3"])
    assert over.policy.policy == Straight(0.3) and over.parameters["policy.speed"] == 0.3
    with pytest.raises(PolicyError, match="hold has no such parameter; it has: none"):
        choose("hold", ["speed=1"])
    with pytest.raises(PolicyError, match="weights: impact:x.safetensors has no such"):
        choose("impact:x.safetensors", ["weights=y.safetensors"])
