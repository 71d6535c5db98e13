"""States come back as they were saved; what cannot be resumed is one clear line."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from drpbench.learning.checkpoints import CheckpointError, Checkpoints
from drpbench.learning.cloning import TrainingState


def state(step, width=3):
    """A state with a tree of several levels, and an integer among the optimiser's numbers."""
    parameters = {"a": {"kernel": jnp.full((2, width), step + 0.1)}, "b": [jnp.arange(4.0) * step]}
    optimiser = (jnp.int32(step), jax.tree.map(jnp.square, parameters))
    average = jax.tree.map(lambda leaf: 0.5 * leaf, parameters)
    return TrainingState(jnp.int32(step), parameters, average, optimiser)


@pytest.fixture
def saved(tmp_path):
    """Three states saved, the folder closed again."""
    checkpoints = Checkpoints(tmp_path / "run")
    assert checkpoints.latest is None
    for step in (10, 20, 30):
        checkpoints.save(state(step))
    checkpoints.close()
    return tmp_path / "run"


def test_the_last_state_comes_back_to_the_bit(saved):
    checkpoints = Checkpoints(saved)
    assert checkpoints.latest == 30
    found, expected = checkpoints.load(state(0)), state(30)
    assert jax.tree.structure(found) == jax.tree.structure(expected)
    for a, b in zip(jax.tree.leaves(found), jax.tree.leaves(expected), strict=True):
        assert a.dtype == b.dtype and np.array_equal(a, b)


def test_the_last_two_are_kept(saved):
    assert {path.name for path in saved.iterdir()} == {"20", "30"}


def test_an_empty_folder_has_nothing_to_resume(tmp_path):
    with pytest.raises(CheckpointError, match="no checkpoint to resume: leave out --resume"):
        Checkpoints(tmp_path / "run").load(state(0))


@pytest.mark.parametrize(
    "like", [state(0, width=5), replace(state(0), optimiser=())], ids=["shape", "tree"]
)
def test_the_state_of_another_network_is_refused(saved, like):
    with pytest.raises(CheckpointError, match="run/30 cannot be resumed") as raised:
        Checkpoints(saved).load(like)
    assert "\n" not in str(raised.value)
