"""IMPACT as a policy: one inference a control step, of which one waypoint is commanded."""

import functools
from collections.abc import Callable
from dataclasses import dataclass, field

import jax
from jaxtyping import Array, Float, PRNGKeyArray

from drpbench.contract import EPISODE, Observation
from drpbench.robot import PANDA, Robot

from .at_once import at_once
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
    return at_once(functools.partial(apply, size, robot=robot))
