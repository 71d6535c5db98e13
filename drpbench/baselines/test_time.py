"""Test-time optimisation: of many ways that a policy draws, the one that touches least is taken.

When an episode begins, a policy that draws its actions leads the arm, without dynamics, to the goal
as often as `rollouts` says, in the scene as its points show it. Of the ways that end near the goal,
the one with the fewest scene points near the arm is given its times within the arm's limits
(`retiming.retime`) and tracked. After Dalal et al., Neural MP (arXiv 2409.05864), whose numbers
these are. What moves later is not reacted to.
"""

from dataclasses import dataclass, field, replace
from typing import Any, Protocol

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PRNGKeyArray

from drpbench.contract import EPISODE, ROBOT_POINTS, Observation, Policy, Scalar
from drpbench.planning.polyline import between
from drpbench.planning.retiming import retime, uniform
from drpbench.policies import squared_distances
from drpbench.robot import PANDA, Robot

_WAYPOINTS = 64  # of a way, evenly spaced: what is drawn trembles
_SAMPLES = 256  # of a trajectory


class Drawing(Policy, Protocol):
    """A policy that can draw its actions."""

    def drawn(self) -> Policy:
        """The same, drawing by the key that `act` gets."""
        ...


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Tracked:
    """The trajectory that is tracked, and how far."""

    q: Float[Array, "*batch N J"]
    """[rad] at equal steps of time"""
    duration: Float[Array, "*batch"]  # [s]
    since: Float[Array, "*batch"]
    """[s] since it was begun"""


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class TestTimeOptimisation:
    """Over a policy that can draw its actions (`drawn`)."""

    __test__ = False  # for pytest: it is no test

    policy: Any
    reached: Scalar = 0.1
    """[rad] of the goal's joints, in norm, within which a way counts."""
    near: Scalar = 0.01
    """[m] of the arm's spheres within which a scene point counts."""
    speed: Scalar = 0.5
    """Share of the pace that the arm's limits allow."""
    rollouts: int = field(default=100, metadata={"static": True})
    steps: int = field(default=100, metadata={"static": True})
    """Of the policy in a rollout."""
    robot: Robot = field(default=PANDA, metadata={"static": True})
    control_period: float = field(default=EPISODE.period, metadata={"static": True})

    privileged = False

    def init(self, observation: Observation) -> Tracked:
        ways = self._ways(observation)
        path, _ = uniform(ways[self._best(observation, ways)], _WAYPOINTS, self.robot)
        timed = retime(path, _SAMPLES, self.robot)
        duration = jnp.maximum(jnp.asarray(timed.duration), 1e-3)
        return Tracked(jnp.asarray(timed.q), duration, jnp.float32(0.0))

    def act(
        self, observation: Observation, carry: Tracked, key: PRNGKeyArray | None
    ) -> tuple[Float[Array, " J"], Tracked]:
        ahead = self.speed * (carry.since + self.robot.servo_lag)
        share = jnp.clip(ahead / carry.duration, 0.0, 1.0)
        (target,) = between(carry.q, share[None] * (_SAMPLES - 1))
        return target, replace(carry, since=carry.since + jnp.float32(self.control_period))

    def _ways(self, observation: Observation) -> Float[Array, "R T J"]:
        """Where the drawing policy leads the arm, from where it is, in each rollout."""
        policy, robot = self.policy.drawn(), self.robot
        surface = robot.surface_points(ROBOT_POINTS)

        def seen(q: Array) -> Observation:
            return replace(
                observation,
                joint_position=q,
                joint_velocity=jnp.zeros_like(q),
                robot_points=surface.world(robot.link_poses(q)),
            )

        def step(state: tuple, key: PRNGKeyArray) -> tuple[tuple, Array]:
            q, carry = state
            target, carry = policy.act(seen(q), carry, key)
            q = jnp.clip(target, robot.joint_lower, robot.joint_upper).astype(q.dtype)
            return (q, carry), q

        start = observation.joint_position

        def rollout(key: PRNGKeyArray) -> Array:
            begun = (start, policy.init(observation))
            _, way = jax.lax.scan(step, begun, jax.random.split(key, self.steps))
            return jnp.concatenate([start[None], way])

        return jax.vmap(rollout)(jax.random.split(jax.random.key(0), self.rollouts))

    def _best(self, observation: Observation, ways: Float[Array, "R T J"]) -> Array:
        """The way that touches least of those that end at the goal; else what ends nearest."""
        left = jnp.linalg.norm(ways[:, -1] - observation.goal_joints, axis=-1)
        model = self.robot.moving_spheres
        scene = jnp.where(observation.scene_mask[:, None], observation.scene_points, 1.0e3)

        def touched(q: Array) -> Array:
            away = squared_distances(model.world(self.robot.link_poses(q)), scene)
            within = jnp.square(jnp.asarray(model.radius) + self.near)
            return jnp.sum(jnp.any(away < within[:, None], axis=0))

        counts = jnp.sum(jax.lax.map(jax.vmap(touched), ways), axis=-1)
        arrives = left < self.reached
        cost = jnp.where(arrives, counts.astype(left.dtype), 1.0e6 * (1.0 + left))
        return jnp.argmin(cost)
