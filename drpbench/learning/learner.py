"""What training must know of a network, beyond what a file of its weights knows."""

from __future__ import annotations

from functools import partial
from typing import Any, Protocol, runtime_checkable

import jax
from jaxtyping import Array, Float, PRNGKeyArray

from drpbench.contract import SCENE_POINTS, observation_spec
from drpbench.errors import DrpbenchError
from drpbench.plugins.errors import told
from drpbench.plugins.imported import built
from drpbench.plugins.imported import check as check_policy
from drpbench.policies.networks import Network
from drpbench.robot import PANDA, Robot

from .batches import sample
from .demonstrations import Demonstrations


class LearnerError(DrpbenchError):
    """A learner that cannot be found, or that cannot learn; the message is one line."""


@runtime_checkable
class Learner(Network, Protocol):
    """A network of one size that can be trained: a frozen dataclass whose fields are the sizes.

    Whoever inherits from this class writes `initial`, `loss` and `policy`; the other methods have
    defaults. Methods are pure functions: they are compiled.
    """

    @property
    def robot(self) -> Robot:
        """The arm that the network is for."""
        return PANDA

    @classmethod
    def sizes(cls) -> dict[str, Learner]:
        """The sizes that have a name (`drpbench train --size NAME`); the first is the default."""
        return {"default": cls()}

    def initial(self, seed: int) -> Any:
        """The parameters of an untrained network: a pytree of float32 arrays."""
        ...

    def shapes(self) -> Any:
        return jax.eval_shape(lambda: self.initial(0))

    def sample(self, key: PRNGKeyArray, demonstrations: Demonstrations, count: int) -> Any:
        """What the network sees in one step, and what it should answer: `count` samples.

        Any pytree of arrays with the leading axis `count`. All randomness comes from `key`; a loss
        that needs some takes it from a leaf of keys. The default is
        `drpbench.learning.batches.Batch`.
        """
        return sample(key, demonstrations, count, SCENE_POINTS, self.robot)

    def loss(self, parameters: Any, batch: Any, precision: str) -> Float[Array, ""]:
        """The mean loss over the samples. `precision` (float32 or bfloat16) is the network's; the
        loss itself is float32."""
        ...


def check(
    learner: Learner, demonstrations: Demonstrations, count: int, precision: str = "float32"
) -> None:
    """Raises LearnerError unless `learner` can learn from these demonstrations, `count` samples a
    step.

    Works on shapes alone, so that a mistake costs neither compilation nor training.
    """
    name, doing = learner.title(), "initial"

    def one_step(demonstrations: Demonstrations) -> Any:
        nonlocal doing
        parameters = learner.initial(0)
        if wrong := {str(leaf.dtype) for leaf in jax.tree.leaves(parameters)} - {"float32"}:
            raise LearnerError(f"{name}: expected parameters of float32, got {sorted(wrong)[0]}")
        doing = "sample"
        batch = learner.sample(jax.random.key(0), demonstrations, count)
        if wrong := {leaf.shape for leaf in jax.tree.leaves(batch) if leaf.shape[:1] != (count,)}:
            raise LearnerError(
                f"{name}: expected samples with the leading axis {count}, "
                f"got shape {sorted(wrong)[0]}"
            )
        doing = "loss"
        return learner.loss(parameters, batch, precision)

    try:
        loss = jax.eval_shape(one_step, demonstrations)
    except LearnerError:
        raise
    except Exception as error:  # their own code
        raise LearnerError(f"{name}: {doing} failed: {told(error)}") from None
    if getattr(loss, "shape", None) != () or loss.dtype != "float32":
        raise LearnerError(f"{name}: expected one float32 number as loss, got {loss}")
    policy = built(name, partial(learner.policy, learner.initial(0)), {})
    check_policy(name, policy, observation_spec(learner.robot))
