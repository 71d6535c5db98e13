"""Trivial baselines, blind to the scene: hold still, drive straight, wait folded away."""

from dataclasses import dataclass, field, replace

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, PRNGKeyArray

from drpbench.contract import EPISODE, Observation, Scalar
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


FOLDED = np.array([0.0, -0.85, 0.3, -1.56, 0.19, 3.6, 0.87], np.float32)
"""The Panda drawn back over its base [rad]: no sphere of it is farther than 0.08 m in front of the
base's axis, nor 0.28 m from it."""


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class FoldAndWait:
    """Folds the arm away, waits until the boxes of every task have vanished, and then drives
    straight to the goal. What it scores is what waiting earns without seeing anything."""

    wait: Scalar = 15.0
    """[s] after which it sets out; the last boxes vanish at 15 s."""
    speed: Scalar = 1.0
    robot: Robot = field(default=PANDA, metadata={"static": True})
    control_period: float = field(default=EPISODE.period, metadata={"static": True})

    privileged = False

    def init(self, observation: Observation) -> Int[Array, ""]:
        return jnp.int32(0)

    def act(
        self, observation: Observation, carry: Int[Array, ""], key: PRNGKeyArray | None
    ) -> tuple[Float[Array, " J"], Int[Array, ""]]:
        waits = carry * self.control_period < self.wait
        folded = jnp.asarray(FOLDED, observation.goal_joints.dtype)
        goal = jnp.where(waits, folded, observation.goal_joints)
        straight = Straight(self.speed, self.robot)
        target, _ = straight.act(replace(observation, goal_joints=goal), (), key)
        return target, carry + 1
