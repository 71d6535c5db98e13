"""Training lowers its loss, is the same on any number of devices, and goes on after a cut as if it
had not been."""

import json
import os
import subprocess
import sys

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from drpbench.learning import train as training
from drpbench.learning.checkpoints import CheckpointError
from drpbench.learning.history import History
from drpbench.learning.pretraining import Pretraining, Settings
from drpbench.policies.networks.impact import SIZES, ImpactSize
from drpbench.policies.weights import card

pytestmark = pytest.mark.slow

TINY = ImpactSize(
    scene_points=64,
    scene_tokens=4,
    robot_points=16,
    robot_tokens=2,
    radius=0.2,
    samples=4,
    point_mlp=(8, 8),
    joint_mlp=(16,),
    width=16,
    feed_forward=16,
    heads=2,
    encoder_layers=1,
    decoder_layers=1,
)


class Fixed:
    """A feed of demonstrations that are there already."""

    about = "a handful"

    def __init__(self, demonstrations):
        self._demonstrations = demonstrations

    def begin(self):
        return self._demonstrations

    def refresh(self, resident):
        return resident


@pytest.fixture(autouse=True)
def tiny(monkeypatch):
    monkeypatch.setitem(SIZES, "tiny", TINY)


def run(out, **changes):
    settings = Settings(steps=12, batch=16, warmup=2)
    return training.Run(
        out, "tiny", settings, report_every=2, checkpoint_every=4, validation_problems=0, **changes
    )


def test_the_loss_falls(demonstrations):
    trainer = Pretraining(TINY, Settings(steps=300, batch=64, warmup=10, learning_rate=3e-3))
    state, losses = trainer.advance(trainer.begin(), trainer.resident(demonstrations), steps=300)
    assert np.mean(losses[-20:]) < 0.75 * np.mean(losses[:20])
    assert int(state.step) == 300
    gap = jax.tree.map(lambda a, b: jnp.abs(a - b).max(), state.parameters, state.average)
    assert 0 < max(jax.tree.leaves(gap)) < 0.1


class Cut(Exception):
    """The power fails."""


def test_a_run_that_was_cut_off_goes_on_to_the_same_losses(tmp_path, demonstrations):
    feed = Fixed(demonstrations)
    training.train(run(tmp_path / "whole"), feed, lambda line, run: None)

    def cut(line, run):
        if line.step == 10:  # two steps after a checkpoint
            raise Cut

    with pytest.raises(Cut):
        training.train(run(tmp_path / "cut"), feed, cut)
    told = []
    training.train(
        run(tmp_path / "cut", resume=True), feed, lambda line, run: told.append(line.step)
    )
    assert told == [10, 12]
    whole, resumed = (History(tmp_path / name / "history.csv").read() for name in ("whole", "cut"))
    assert [line.step for line in resumed] == [2, 4, 6, 8, 10, 12]
    assert [line.loss for line in resumed] == [line.loss for line in whole]
    files = [(tmp_path / name / "weights.safetensors").read_bytes() for name in ("whole", "cut")]
    assert len(files[0]) == len(files[1])


def test_runs_are_not_overwritten_mixed_or_invented(tmp_path, demonstrations):
    feed, out = Fixed(demonstrations), tmp_path / "run"
    with pytest.raises(training.TrainingError, match="holds no run to resume"):
        training.train(run(out, resume=True), feed, lambda line, run: None)
    training.train(run(out), feed, lambda line, run: None)
    with pytest.raises(training.TrainingError, match="holds a run"):
        training.train(run(out), feed, lambda line, run: None)
    with pytest.raises(training.TrainingError, match="were done before"):
        training.train(run(out, resume=True), feed, lambda line, run: None)
    kept = json.loads((out / "settings.json").read_text())
    (out / "settings.json").write_text(json.dumps([kept[0] | {"batch": 17}]))
    with pytest.raises(training.TrainingError, match="batch 17, not 16"):
        training.train(run(out, resume=True), feed, lambda line, run: None)


def test_a_resumed_run_may_go_further_and_says_so(tmp_path, demonstrations):
    feed, out = Fixed(demonstrations), tmp_path / "run"
    training.train(run(out), feed, lambda line, run: None)
    settings = Settings(steps=14, batch=16, warmup=2, learning_rate=5e-4)
    further = training.Run(
        out, "tiny", settings, True, report_every=2, checkpoint_every=2, validation_problems=0
    )
    assert training.train(further, feed, lambda line, run: None).step == 14
    assert card(out / "weights.safetensors")["schedule"] == (
        "from step 0 towards 12 at 0.001; then from step 12 towards 14 at 0.0005"
    )


def test_a_damaged_checkpoint_is_one_clear_error(tmp_path, demonstrations):
    feed, out = Fixed(demonstrations), tmp_path / "run"
    training.train(run(out), feed, lambda line, run: None)
    for path in (out / "checkpoints").rglob("*"):
        if path.is_file():
            path.write_bytes(b"")
    with pytest.raises(CheckpointError, match="cannot be resumed|holds no checkpoint"):
        training.train(run(out, resume=True), feed, lambda line, run: None)


@pytest.mark.parametrize(
    ("changes", "wrong"),
    [
        ({"size": "huge"}, "no size 'huge'; there are: full, small"),
        ({"checkpoint_every": 5}, "--checkpoint-every 5: must be a multiple"),
        ({"settings": Settings(steps=7)}, "--steps 7: must be a multiple"),
    ],
)
def test_what_cannot_be_run_is_said(tmp_path, changes, wrong):
    given = {"size": "tiny", "settings": Settings(steps=4), "report_every": 2} | changes
    with pytest.raises(training.TrainingError, match=wrong):
        training.Run(tmp_path, **({"checkpoint_every": 2} | given))


PROGRAM = """
import pickle, sys
import jax
from drpbench.learning.pretraining import Pretraining, Settings
size, demonstrations = pickle.load(open(sys.argv[1], "rb"))
trainer = Pretraining(size, Settings(steps=3, batch=16, warmup=1))
_, losses = trainer.advance(trainer.begin(), trainer.resident(demonstrations), steps=3)
print(jax.device_count(), *[float(x) for x in losses])
"""


def test_two_devices_learn_what_one_learns(tmp_path, demonstrations):
    import pickle

    path = tmp_path / "task"
    path.write_bytes(pickle.dumps((TINY, jax.tree.map(np.asarray, demonstrations))))
    lines = []
    for devices in (1, 2):
        flags = f"--xla_force_host_platform_device_count={devices}"
        done = subprocess.run(
            [sys.executable, "-c", PROGRAM, str(path)],
            env={**os.environ, "XLA_FLAGS": flags, "JAX_PLATFORMS": "cpu"},
            capture_output=True,
            text=True,
            check=True,
        )
        lines.append([float(x) for x in done.stdout.split()])
    assert [line[0] for line in lines] == [1, 2]
    assert lines[0][1:] == pytest.approx(lines[1][1:], rel=1e-4)
