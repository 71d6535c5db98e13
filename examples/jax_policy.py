"""A policy in JAX: two pure functions for one environment. The runner vmaps and jits them with the
world.

drpbench run --task FDO --problems 20 --policy examples.jax_policy:Approach --policy-arg gain=0.2
"""

from dataclasses import dataclass

import jax
import jax.numpy as jnp


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Approach:
    """A share of the way to the goal, at every step, and never more than `most` radians."""

    gain: float = 0.1
    most: float = 0.05

    privileged = False

    def init(self, observation):
        return ()

    def act(self, observation, carry, key):
        away = observation.goal_joints - observation.joint_position
        step = jnp.clip(self.gain * away, -self.most, self.most)
        return observation.joint_position + step, carry
