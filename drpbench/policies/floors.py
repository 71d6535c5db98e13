"""The two floors that every policy is measured against: standing still, and the straight line."""

from dataclasses import dataclass, field

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PRNGKeyArray

from drpbench.contract import Observation, Scalar
from drpbench.robot import PANDA, Robot


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Hold:
    """Stays where the episode began."""

    privileged = False

    def init(self, observation: Observation) -> Float[Array, " J"]:
        return observation.joint_position

    def act(
        self, observation: Observation, carry: Float[Array, " J"], key: PRNGKeyArray | None
    ) -> tuple[Float[Array, " J"], Float[Array, " J"]]:
        return carry, carry


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Straight:
    """The straight line to the goal joints, at a share of the velocity limits; blind to the
    scene."""

    speed: Scalar = 0.5
    robot: Robot = field(default=PANDA, metadata={"static": True})

    privileged = False

    def init(self, observation: Observation) -> tuple[()]:
        return ()

    def act(
        self, observation: Observation, carry: tuple[()], key: PRNGKeyArray | None
    ) -> tuple[Float[Array, " J"], tuple[()]]:
        away = observation.goal_joints - observation.joint_position
        # The joint that is slowest relative to its limit sets the pace of all.
        needed = jnp.max(jnp.abs(away) / jnp.asarray(self.robot.velocity_limit, away.dtype))
        share = jnp.minimum(1.0, self.speed * self.robot.servo_lag / jnp.maximum(needed, 1e-9))
        return observation.joint_position + share * away, carry
