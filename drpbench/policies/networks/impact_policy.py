"""IMPACT as a policy: one inference a control step, of which one waypoint is commanded."""

import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PRNGKeyArray

from drpbench.contract import EPISODE, Observation
from drpbench.robot import PANDA, Robot

from .chunks import commanded
from .impact import Parameters, apply
from .impact_size import FULL, ImpactSize


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Impact:
    """The network's chunk at each control step; the servos get its waypoint `lookahead`
    (`chunks.py`)."""

    parameters: Parameters
    size: ImpactSize = field(metadata={"static": True})
    weights: str = field(default="", metadata={"static": True})
    """Which numbers these are, for a result's header: the SHA-256 of the file they came from, if
    any."""
    robot: Robot = field(default=PANDA, metadata={"static": True})
    control_period: float = field(default=EPISODE.period, metadata={"static": True})

    privileged = False

    @property
    def about(self) -> str:
        """What it is, for a result's header: whose sizes these are is not in a name."""
        count = sum(leaf.size for leaf in jax.tree.leaves(self.parameters))
        if self.size == FULL:
            return f"IMPACT in the paper's size, {count / 1e6:.2f} million parameters"
        more = [f"{self.size.feelers} feelers"] if self.size.feelers else []
        more += ["a look at the arm at its goal"] if self.size.sees_goal else []
        told = f", with {' and '.join(more)}" if more else ""
        return (
            f"a small IMPACT of {count / 1e3:.0f} thousand parameters{told}; the paper's has 4.67 "
            "million and none of that"
        )

    def init(self, observation: Observation) -> tuple[()]:
        return ()

    def act(
        self, observation: Observation, carry: tuple[()], key: PRNGKeyArray | None
    ) -> tuple[Float[Array, " J"], tuple[()]]:
        q, goal = observation.joint_position, observation.goal_joints
        clouds = (observation.scene_points, observation.scene_mask, observation.robot_points)
        chunk = _batching(self.size, self.robot)(self.parameters, *clouds, q, goal)
        return commanded(chunk, q, goal, self.robot, self.control_period), carry


@functools.cache
def _batching(size: ImpactSize, robot: Robot) -> Callable[..., Float[Array, "*batch 10 J"]]:
    """`apply`, given a whole batch at once where it is vmapped: it then knows the batch's size, and
    takes it in pieces that fit the cache."""

    def whole(parameters: Parameters, *seen: Any) -> Array:
        return apply(size, parameters, *seen, robot=robot)

    @jax.custom_batching.custom_vmap
    def network(parameters: Parameters, *seen: Array) -> Array:
        return whole(parameters, *seen)

    @network.def_vmap
    def _(
        count: int, batched: Sequence, parameters: Parameters, *seen: Array
    ) -> tuple[Array, bool]:
        of_parameters, *of_seen = batched
        if any(jax.tree.leaves(of_parameters)):
            axes = jax.tree.map(lambda is_batched: 0 if is_batched else None, batched)
            return jax.vmap(whole, axes)(parameters, *seen), True
        seen = tuple(
            x if is_batched else jnp.broadcast_to(x, (count, *x.shape))
            for x, is_batched in zip(seen, of_seen, strict=True)
        )
        return whole(parameters, *seen), True

    return network
