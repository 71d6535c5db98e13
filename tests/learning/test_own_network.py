"""The network of docs/training.md, trained, resumed, validated and run by the commands that the
page shows."""

import csv
import re
import shutil
import sys
from pathlib import Path

import jax
import numpy as np
import pytest

from drpbench.cli.learning import train
from drpbench.contract import Policy
from drpbench.errors import DrpbenchError
from drpbench.learning.demonstrations import Shards
from drpbench.learning.learners import learner
from drpbench.plugins.errors import PolicyError
from drpbench.plugins.registry import choose
from drpbench.policies.weights import WeightsError, card, checksum

PAGE = Path(__file__).parents[2] / "docs" / "training.md"


@pytest.fixture(scope="module")
def folder(tmp_path_factory, demonstrations):
    """A user's folder: the page's file, and demonstrations."""
    folder = tmp_path_factory.mktemp("mine")
    (source,) = re.findall(r"```python\n# file: reacher.py\n(.*?)```", PAGE.read_text(), re.DOTALL)
    (folder / "reacher.py").write_text(source)
    Shards(folder / "data", "training").add(range(8), jax.tree.map(np.asarray, demonstrations))
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        patch.syspath_prepend(str(folder))
        yield folder
    sys.modules.pop("reacher", None)


def train_it(folder, resume=False, validation_problems=0):
    train(
        "reacher:Reacher",
        out=folder / "run",
        demonstrations=[folder / "data"],
        steps=60,
        batch=32,
        learning_rate=1e-2,
        resume=resume,
        report_every=20,
        checkpoint_every=20,
        validation_problems=validation_problems,
    )


def lines(folder):
    with open(folder / "run" / "history.csv", newline="") as file:
        return list(csv.DictReader(file))


@pytest.fixture(scope="module")
def trained(folder):
    train_it(folder, validation_problems=3)
    return folder


def test_its_loss_falls_and_it_is_validated(trained):
    first, *_, last = lines(trained)
    assert float(last["loss"]) < 0.9 * float(first["loss"])
    assert last["validated"] == "3" and 0 <= int(last["succeeded"]) <= 3


def test_its_checkpoint_resumes_to_the_same_losses(trained):
    before, digest = lines(trained), checksum(trained / "run" / "weights.safetensors")
    shutil.rmtree(trained / "run" / "checkpoints" / "60")  # the power fails before it is written
    train_it(trained, resume=True)
    assert [line["loss"] for line in lines(trained)] == [line["loss"] for line in before]
    assert checksum(trained / "run" / "weights.safetensors") == digest


def test_its_weights_are_a_policy(trained):
    import reacher

    name = "reacher:Reacher:run/weights.safetensors"
    choice = choose(name)
    assert isinstance(choice.policy, Policy) and isinstance(choice.policy, reacher.ReacherPolicy)
    assert choice.parameters["network.width"] == 64
    assert choose(f"{name}+dcp-rmp").parameters["policy.network.width"] == 64
    facts = card(trained / "run" / "weights.safetensors")
    assert facts["training"]["network"] == "reacher:Reacher"
    assert facts["training"]["size"] == "default"
    text = (trained / "run" / "weights.md").read_text()
    assert "Reacher with 5,376 parameters." in text and "| width | 64 |" in text


@pytest.mark.parametrize(
    ("name", "error", "wrong"),
    [
        ("impact:run/weights.safetensors", WeightsError, "unknown network.*got format reacher:R"),
        ("run/weights.safetensors", WeightsError, r"expected impact \(drpbench-impact-1\)"),
        ("reacher:Reacher:absent.safetensors", WeightsError, "no such file"),
        ("reacher:Nothing:run/weights.safetensors", PolicyError, "classes: Reacher"),
        ("reacher:ReacherPolicy:run/weights.safetensors", PolicyError, "subclass of .*Learner"),
        (
            "nothing:run/weights.safetensors",
            PolicyError,
            "no network 'nothing'; there are: impact, neuralmp",
        ),
    ],
)
def test_weights_of_another_network_are_refused(trained, name, error, wrong):
    with pytest.raises(error, match=wrong) as raised:
        choose(name)
    assert "\n" not in str(raised.value)


def test_weights_take_no_argument(trained):
    with pytest.raises(PolicyError, match="has no such parameter"):
        choose("reacher:Reacher:run/weights.safetensors", ["width=3"])


@pytest.mark.parametrize(
    ("name", "size", "wrong"),
    [
        ("nothing", None, "no network 'nothing'; there are: impact, neuralmp, and yours as"),
        ("impact", "huge", "no size 'huge'; there are: full, small"),
        ("reacher:Reacher", "huge", "no size 'huge'; there are: default"),
        ("reacher:ReacherPolicy", None, "subclass of .*Learner"),
        ("reacher:jnp", None, "expected a class of a network, got jnp of type module"),
        ("drpbench.policies.networks.impact_format:ImpactFormat", None, "subclass of .*Learner"),
    ],
)
def test_what_is_no_learner_is_refused(folder, name, size, wrong):
    with pytest.raises(DrpbenchError, match=wrong) as raised:
        learner(name, size)
    assert "\n" not in str(raised.value)
