"""A learner that cannot learn is refused before anything is compiled."""

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import pytest

from drpbench.learning.learner import LearnerError, check
from drpbench.plugins.errors import PolicyError
from drpbench.robot import PANDA

from .tiny import Mean


def refused(demonstrations, kind=LearnerError, **methods):
    """What is said of Mean with other methods."""
    wrong = dataclass(frozen=True)(type("Wrong", (Mean,), methods))
    with pytest.raises(kind) as raised:
        check(wrong(), demonstrations, 4)
    message = str(raised.value)
    assert message.startswith("Wrong") and "\n" not in message
    return message


def test_the_defaults_are_enough(demonstrations):
    mean = Mean()
    check(mean, demonstrations, 4)
    assert mean.robot is PANDA and Mean.sizes() == {"default": mean}
    assert Mean.from_settings(Mean(2.0).settings()) == Mean(2.0)
    assert mean.shapes()["chunk"].shape == (10, 7)


def test_a_fault_of_their_own_is_named_with_its_place(demonstrations):
    message = refused(demonstrations, loss=lambda self, p, b, precision: b.nothing)
    assert "loss failed: AttributeError" in message and "test_learner.py" in message
    assert "initial failed" in refused(demonstrations, initial=lambda self, seed: 1 / 0)


def test_parameters_are_float32(demonstrations):
    message = refused(demonstrations, initial=lambda self, seed: {"chunk": jnp.zeros(3, "int32")})
    assert "expected parameters of float32, got int32" in message


def test_samples_have_the_batch_in_front(demonstrations):
    message = refused(demonstrations, sample=lambda self, key, d, n: {"x": jnp.zeros((7, n))})
    assert "leading axis 4, got shape (7, 4)" in message


def test_a_loss_is_one_number(demonstrations):
    message = refused(demonstrations, loss=lambda self, p, b, precision: b[:, 0, 0])
    assert "expected one float32 number as loss, got" in message and "(4,)" in message
    assert "loss failed" in refused(demonstrations, loss=lambda self, p, b, precision: "low")


def test_what_it_makes_is_a_policy(demonstrations):
    message = refused(demonstrations, PolicyError, policy=lambda self, p, weights="": jax)
    assert "is no policy" in message
