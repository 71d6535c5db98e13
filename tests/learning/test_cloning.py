"""Training lowers its loss, and is the same on any number of devices."""

import os
import pickle
import subprocess
import sys

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from drpbench.learning.cloning import Cloning, CloningSettings

from ..conftest import CHEAP
from .tiny import LEARNER, MEAN


def test_the_loss_falls(demonstrations):
    trainer = Cloning(LEARNER, CloningSettings(steps=300, batch=64, warmup=10, learning_rate=3e-3))
    state, losses = trainer.advance(trainer.begin(), trainer.resident(demonstrations), steps=300)
    assert np.mean(losses[-20:]) < 0.75 * np.mean(losses[:20])
    assert int(state.step) == 300
    gap = jax.tree.map(lambda a, b: jnp.abs(a - b).max(), state.parameters, state.average)
    assert 0 < max(jax.tree.leaves(gap)) < 0.1


PROGRAM = """
import pickle, sys
import jax
from drpbench.learning.cloning import Cloning, CloningSettings
learner, demonstrations = pickle.load(open(sys.argv[1], "rb"))
trainer = Cloning(learner, CloningSettings(steps=3, batch=16, warmup=1))
_, losses = trainer.advance(trainer.begin(), trainer.resident(demonstrations), steps=3)
print(jax.device_count(), *[float(x) for x in losses])
"""


def test_two_devices_learn_what_one_learns(tmp_path, demonstrations):
    path = tmp_path / "task"
    path.write_bytes(pickle.dumps((MEAN, jax.tree.map(np.asarray, demonstrations))))
    lines = []
    for devices in (1, 2):
        flags = f"{CHEAP} --xla_force_host_platform_device_count={devices}"
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
