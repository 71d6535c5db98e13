"""A mixture of Gaussians over actions: the head of NeuralMP's network."""

from __future__ import annotations

from dataclasses import dataclass

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PRNGKeyArray


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class GaussianMixture:
    """p(a) = sum_m softmax(logits)_m N(a; mean_m, diag(scale_m)^2)."""

    logits: Float[Array, "*batch M"]
    mean: Float[Array, "*batch M J"]
    scale: Float[Array, "*batch M J"]

    def log_likelihood(self, action: Float[Array, "*batch J"]) -> Float[Array, "*batch"]:
        """log p(action)."""
        off = (action[..., None, :] - self.mean) / self.scale
        each = -0.5 * jnp.square(off) - jnp.log(self.scale) - 0.5 * jnp.log(2.0 * jnp.pi)
        share = jax.nn.log_softmax(self.logits, axis=-1)
        return jax.nn.logsumexp(share + jnp.sum(each, axis=-1), axis=-1)

    def likeliest(self) -> Float[Array, "*batch J"]:
        """The mean of the mode with the largest share."""
        return _chosen(self.mean, jnp.argmax(self.logits, axis=-1))

    def draw(self, key: PRNGKeyArray) -> Float[Array, "*batch J"]:
        """A random action."""
        mode_key, noise_key = jax.random.split(key)
        mode = jax.random.categorical(mode_key, self.logits, axis=-1)
        mean, scale = _chosen(self.mean, mode), _chosen(self.scale, mode)
        return mean + scale * jax.random.normal(noise_key, mean.shape)


def _chosen(of_modes: Array, mode: Array) -> Array:
    return jnp.take_along_axis(of_modes, mode[..., None, None], axis=-2)[..., 0, :]
