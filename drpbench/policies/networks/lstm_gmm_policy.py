"""NeuralMP's network as a policy: one inference a control step, of which the likeliest motion is
commanded."""

import functools
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int, PRNGKeyArray

from drpbench.contract import EPISODE, Observation
from drpbench.robot import PANDA, Robot

from .at_once import at_once
from .chunks import CHUNK, commanded
from .gaussian_mixture import GaussianMixture
from .lstm_gmm import Parameters, start, step
from .lstm_gmm_size import LstmGmmSize


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Memory:
    """What is carried from one control step to the next."""

    state: Float[Array, "*batch 2 layers width"]
    since: Int[Array, "*batch"]
    """Control steps since the LSTM began anew."""


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class LstmGmm:
    """The mean of the mixture's likeliest mode, as the servos' target three control steps ahead
    (`chunks.py`).

    The LSTM begins anew every `size.horizon` steps, as in training. The published policy draws the
    mode by its share; the likeliest one makes the policy deterministic. `drawn()` draws from the
    whole mixture.
    """

    parameters: Parameters
    size: LstmGmmSize = field(metadata={"static": True})
    weights: str = field(default="", metadata={"static": True})
    """Which numbers these are, for a result's header: the SHA-256 of the file they came from, if
    any."""
    robot: Robot = field(default=PANDA, metadata={"static": True})
    control_period: float = field(default=EPISODE.period, metadata={"static": True})
    draws: bool = field(default=False, metadata={"static": True})
    """Whether an action is drawn from the mixture; else it is the likeliest mode's mean."""

    privileged = False

    @property
    def about(self) -> str:
        """What it is, for a result's header: whose sizes these are is not in a name."""
        count = sum(leaf.size for leaf in jax.tree.leaves(self.parameters))
        return (
            f"NeuralMP's architecture with {count / 1e6:.2f} million parameters (the published one "
            "has 20), trained here"
        )

    def drawn(self) -> "LstmGmm":
        """The same, whose actions are drawn by the key that `act` gets."""
        return replace(self, draws=True)

    def init(self, observation: Observation) -> Memory:
        return Memory(start(self.size), jnp.int32(0))

    def act(
        self, observation: Observation, carry: Memory, key: PRNGKeyArray | None
    ) -> tuple[Float[Array, " J"], Memory]:
        q, goal = observation.joint_position, observation.goal_joints
        clouds = (observation.scene_points, observation.scene_mask, observation.robot_points)
        state = jnp.where(carry.since == 0, 0.0, carry.state)
        one_step = _batching(self.size, self.robot)
        *of_mixture, state = one_step(self.parameters, *clouds, q, goal, state)
        mixture = GaussianMixture(*of_mixture)
        if self.draws:
            assert key is not None
            action = mixture.draw(key)
        else:
            action = mixture.likeliest()
        chunk = jnp.broadcast_to(action, (CHUNK, *action.shape))
        since = (carry.since + 1) % self.size.horizon
        return commanded(chunk, q, goal, self.robot, self.control_period), Memory(state, since)


@functools.cache
def _batching(size: LstmGmmSize, robot: Robot) -> Callable[..., Any]:
    def arrays(parameters: Parameters, *seen: Array) -> tuple[Array, ...]:
        """The mixture's arrays and the state: what says which are batched is no mixture."""
        mixture, state = step(size, parameters, *seen, robot=robot)
        return mixture.logits, mixture.mean, mixture.scale, state

    return at_once(arrays)
