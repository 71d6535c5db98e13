"""A run goes on after a cut as if it had not been, and refuses what cannot be run."""

import json
from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from drpbench.generation.training_problems import ABROAD
from drpbench.learning import train as training
from drpbench.learning.checkpoints import CheckpointError
from drpbench.learning.cloning import Cloning, CloningSettings
from drpbench.learning.history import History
from drpbench.learning.learners import learner
from drpbench.learning.train import TrainingError, train
from drpbench.learning.validation import Score
from drpbench.policies import Hold
from drpbench.policies.networks.impact_format import ImpactFormat
from drpbench.policies.weights import card, checksum, load_parameters

from .tiny import Fixed, Mean, run


def ignored(line, run): ...


class Cut(Exception):
    """The power fails."""


def test_a_run_that_was_cut_off_goes_on_to_the_same_losses(tmp_path, demonstrations):
    feed = Fixed(demonstrations)
    train(run(tmp_path / "whole"), feed, ignored)

    def cut(line, run):
        if line.step == 10:  # two steps after a checkpoint
            raise Cut

    with pytest.raises(Cut):
        train(run(tmp_path / "cut"), feed, cut)
    steps = []
    train(run(tmp_path / "cut", resume=True), feed, lambda line, run: steps.append(line.step))
    assert steps == [10, 12]
    whole, resumed = (History(tmp_path / name / "history.csv").read() for name in ("whole", "cut"))
    assert [line.step for line in resumed] == [2, 4, 6, 8, 10, 12]
    assert [line.loss for line in resumed] == [line.loss for line in whole]
    files = [tmp_path / name / "weights.safetensors" for name in ("whole", "cut")]
    assert checksum(files[0]) == checksum(files[1]) != ""


def test_runs_are_not_overwritten_mixed_or_invented(tmp_path, demonstrations):
    feed, out = Fixed(demonstrations), tmp_path / "run"
    with pytest.raises(TrainingError, match="holds no run to resume"):
        train(run(out, resume=True), feed, ignored)
    train(run(out), feed, ignored)
    with pytest.raises(TrainingError, match="holds a run"):
        train(run(out), feed, ignored)
    with pytest.raises(TrainingError, match="were done before"):
        train(run(out, resume=True), feed, ignored)
    kept = json.loads((out / "settings.json").read_text())
    (out / "settings.json").write_text(json.dumps([kept[0] | {"batch": 17}]))
    with pytest.raises(TrainingError, match="batch 17, not 16"):
        train(run(out, resume=True), feed, ignored)


def test_a_resumed_run_may_go_further_and_says_so(tmp_path, demonstrations):
    feed, out = Fixed(demonstrations), tmp_path / "run"
    train(run(out), feed, ignored)
    settings = CloningSettings(steps=14, batch=16, warmup=2, learning_rate=5e-4)
    further = run(out, settings=settings, resume=True, checkpoint_every=2)
    assert train(further, feed, ignored).step == 14
    assert card(out / "weights.safetensors")["schedule"] == (
        "from step 0 towards 12 at 0.001; then from step 12 towards 14 at 0.0005"
    )


def test_a_run_from_when_there_was_one_network_goes_on(tmp_path, demonstrations, monkeypatch):
    assert training._BEFORE_NETWORKS["network"] == ImpactFormat.format()
    feed, out = Fixed(demonstrations), tmp_path / "run"
    train(run(out), feed, ignored)
    stretches = json.loads((out / "settings.json").read_text())
    assert stretches[0].pop("network") == Mean.format()
    monkeypatch.setattr(training, "_BEFORE_NETWORKS", {"network": Mean.format()})
    (out / "settings.json").write_text(json.dumps(stretches))
    longer = {"settings": CloningSettings(steps=14, batch=16, warmup=2), "checkpoint_every": 2}
    assert train(run(out, resume=True, **longer), feed, ignored).step == 14


def test_a_run_states_its_size_by_name_or_in_numbers(tmp_path):
    assert run(tmp_path, learner("impact", "small")).facts()["size"] == "small"
    assert run(tmp_path).facts()["size"] == "default"
    assert run(tmp_path, Mean(3.0)).facts()["size"] == {"scale": 3.0}
    assert run(tmp_path).facts()["batch"] == 16


def test_what_is_validated_stands_in_the_history_and_on_the_card(
    tmp_path, demonstrations, monkeypatch
):
    class Validation:
        def __init__(self, count, robot, families=()):
            self.count, self.abroad = count, families == ABROAD

        def score(self, policy):
            assert isinstance(policy, Hold)
            return Score(self.count, 3, 2, 0 if self.abroad else 1)

    monkeypatch.setattr(training, "Validation", Validation)
    lines = []
    changes = {"validation_problems": 5, "validate_every": 8}
    wanted = run(tmp_path / "run", **changes)
    train(wanted, Fixed(demonstrations), lambda line, run: lines.append(line))
    assert [line.step for line in lines if line.validated] == [8, 12]
    assert (lines[-1].reached, lines[-1].collided, lines[-1].succeeded) == (3, 2, 1)
    scores = card(tmp_path / "run" / "weights.safetensors")["scores"]
    assert scores == "step 12: 1/5 validation problems solved at home, 0/5 abroad"


def test_a_run_begins_from_weights(tmp_path, demonstrations):
    train(run(tmp_path / "first"), Fixed(demonstrations), ignored)
    weights = tmp_path / "first" / "weights.safetensors"
    _, before, _ = load_parameters(weights, {"mean": Mean})
    wanted = run(tmp_path / "second", begun_from=str(weights))
    state = Cloning(wanted.learner, wanted.settings).begin(training._parameters(wanted))
    jax.tree.map(np.testing.assert_array_equal, state.parameters, before)
    train(wanted, Fixed(demonstrations), ignored)
    assert wanted.facts()["begun_from"] == checksum(weights)
    other = run(tmp_path / "third", Mean(3.0), begun_from=str(weights))
    with pytest.raises(TrainingError, match="--from .*other sizes"):
        train(other, Fixed(demonstrations), ignored)


def test_a_loss_that_is_no_number_ends_the_run_and_names_the_step(tmp_path, demonstrations):
    @dataclass(frozen=True)
    class Diverging(Mean):
        def loss(self, parameters, batch, precision):
            return super().loss(parameters, batch, precision) * jnp.nan

    with pytest.raises(TrainingError, match="no number at step 0: .*--learning-rate"):
        train(run(tmp_path / "run", Diverging()), Fixed(demonstrations), ignored)


def test_a_damaged_checkpoint_is_one_clear_error(tmp_path, demonstrations):
    feed, out = Fixed(demonstrations), tmp_path / "run"
    train(run(out), feed, ignored)
    for path in (out / "checkpoints").rglob("*"):
        if path.is_file():
            path.write_bytes(b"")
    with pytest.raises(CheckpointError, match="cannot be resumed|holds no checkpoint"):
        train(run(out, resume=True, steps=16), feed, ignored)


@pytest.mark.parametrize(
    ("changes", "wrong"),
    [
        ({"checkpoint_every": 5}, "--checkpoint-every 5: must be a multiple"),
        ({"settings": CloningSettings(steps=7)}, "--steps 7: must be a multiple"),
    ],
)
def test_what_cannot_be_run_is_said(tmp_path, changes, wrong):
    with pytest.raises(TrainingError, match=wrong):
        run(tmp_path, **changes)
