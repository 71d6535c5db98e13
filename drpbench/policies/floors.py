"""The two floors that every policy is measured against: standing still, and the straight line."""

from dataclasses import dataclass

import jax
import jax.numpy as jnp

from drpbench.contract import Scalar
from drpbench.robot import PANDA


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Hold:
    """Stays where the episode began."""

    privileged = False

    def init(self, observation):
        return observation.joint_position

    def act(self, observation, carry, key):
        return carry, carry


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Straight:
    """The straight line to the goal joints, at a share of the velocity limits; blind to the scene."""

    speed: Scalar = 0.5

    privileged = False

    def init(self, observation):
        return ()

    def act(self, observation, carry, key):
        away = observation.goal_joints - observation.joint_position
        # The joint that is slowest relative to its limit sets the pace of all.
        needed = jnp.max(jnp.abs(away) / jnp.asarray(PANDA.velocity_limit, away.dtype))
        share = jnp.minimum(1.0, self.speed * PANDA.servo_lag / jnp.maximum(needed, 1e-9))
        return observation.joint_position + share * away, carry
