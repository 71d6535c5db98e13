"""Behaviour cloning: a network learns the expert's next moves from demonstrations.

Samples, their point clouds, gradients and updates are one compiled program, many steps a call:
nothing passes through the host. Every random number comes from the seed and the step's number, so
that a run that was cut off goes on as if it had not been.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import optax
from jax.sharding import Mesh, NamedSharding, PartitionSpec
from jaxtyping import Array, Float, Int

from .demonstrations import Demonstrations
from .learner import Learner


@dataclass(frozen=True)
class CloningSettings:
    """The paper's hyperparameters, but for the number of steps (the paper: 1,000,000)."""

    steps: int = 100_000
    batch: int = 512
    learning_rate: float = 1e-3
    weight_decay: float = 0.01
    betas: tuple[float, float] = (0.9, 0.95)
    warmup: int = 100
    clip: float = 1.0
    """Largest norm of a gradient."""
    averaging: float = 0.999
    """Decay of the running average of the weights: the average is what is used and shipped."""
    precision: str = "float32"
    """In which the network computes: float32 or bfloat16. Weights and updates are always float32.
    """
    seed: int = 0


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class TrainingState:
    """All that changes from step to step."""

    step: Int[Array, ""]
    parameters: Any
    average: Any
    optimiser: Any


def piece_size(batch: int) -> int:
    """Samples whose gradient is taken at once: all of them, but on a CPU 16 to 32 where they
    divide."""
    if jax.default_backend() != "cpu":
        return batch
    return next((size for size in range(32, 15, -1) if batch % size == 0), batch)


class Cloning:
    """The compiled training of one network with one set of settings."""

    def __init__(self, learner: Learner, settings: CloningSettings):
        self.learner, self.settings = learner, settings
        self.schedule = optax.warmup_cosine_decay_schedule(
            0.0, settings.learning_rate, settings.warmup, max(settings.steps, settings.warmup + 1)
        )
        self._optimiser = optax.chain(
            optax.clip_by_global_norm(settings.clip),
            optax.adamw(
                self.schedule,
                *settings.betas,
                weight_decay=settings.weight_decay,
                # Weights decay; biases, norms and embeddings, which have one long axis, do not.
                mask=lambda parameters: jax.tree.map(lambda leaf: leaf.ndim > 1, parameters),
            ),
        )
        self._devices = Mesh(np.array(jax.devices()), ("devices",))
        self.advance = jax.jit(self._advance, static_argnames="steps", donate_argnames="state")

    def begin(self, parameters: Any = None) -> TrainingState:
        """The state before the first step: of an untrained network, or of these parameters."""
        if parameters is None:
            # Compiled: dozens of small programs take longer.
            parameters = jax.jit(self.learner.initial, static_argnums=0)(self.settings.seed)
        return self._everywhere(
            TrainingState(
                step=jnp.int32(0),
                parameters=parameters,
                average=jax.tree.map(jnp.copy, parameters),
                optimiser=self._optimiser.init(parameters),
            )
        )

    def _everywhere(self, tree: Any) -> Any:
        """A copy on every device."""
        return jax.device_put(tree, NamedSharding(self._devices, PartitionSpec()))

    def resident(self, demonstrations: Demonstrations) -> Demonstrations:
        """The demonstrations where training needs them: on every device, for good."""
        return self._everywhere(jax.tree.map(jnp.asarray, demonstrations))

    def loss(self, parameters: Any, batch: Any) -> Float[Array, ""]:
        """The learner's loss in the precision of the settings."""
        return self.learner.loss(parameters, batch, self.settings.precision)

    def _gradient(self, parameters: Any, batch: Any) -> tuple[Float[Array, ""], Any]:
        """Loss and gradient over a batch: on a processor in pieces that stay in its cache."""
        pieces = self.settings.batch // piece_size(self.settings.batch)

        def one(total, piece):
            return jax.tree.map(
                jnp.add, total, jax.value_and_grad(self.loss)(parameters, piece)
            ), None

        zeros = (jnp.float32(0), jax.tree.map(jnp.zeros_like, parameters))
        cut = jax.tree.map(lambda leaf: leaf.reshape(pieces, -1, *leaf.shape[1:]), batch)
        total, _ = jax.lax.scan(one, zeros, cut)
        return jax.tree.map(lambda leaf: leaf / pieces, total)

    def _advance(
        self, state: TrainingState, demonstrations: Demonstrations, steps: int
    ) -> tuple[TrainingState, Float[Array, " steps"]]:
        """So many steps further, and the loss of each."""
        split = NamedSharding(self._devices, PartitionSpec("devices"))

        def step(state: TrainingState, _: None) -> tuple[TrainingState, Float[Array, ""]]:
            key = jax.random.fold_in(jax.random.key(self.settings.seed), state.step)
            batch = self.learner.sample(key, demonstrations, self.settings.batch)
            batch = jax.lax.with_sharding_constraint(batch, split)
            loss, gradient = self._gradient(state.parameters, batch)
            updates, optimiser = self._optimiser.update(gradient, state.optimiser, state.parameters)
            parameters = optax.apply_updates(state.parameters, updates)
            # While there is little to average, the average forgets faster.
            keep = jnp.minimum(self.settings.averaging, (1.0 + state.step) / (10.0 + state.step))
            average = optax.incremental_update(parameters, state.average, 1.0 - keep)
            return TrainingState(state.step + 1, parameters, average, optimiser), loss

        return jax.lax.scan(step, state, None, length=steps)
