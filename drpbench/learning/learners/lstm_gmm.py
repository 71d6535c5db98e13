"""NeuralMP's network learns: the likelihood of what the expert does over a few control steps in a
row.

The steps of a sequence are those of a sample's chunk: the arm is at each of its waypoints in turn,
in a scene that stands still.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import jax.numpy as jnp
from jaxtyping import Array, Float, PRNGKeyArray

from drpbench.learning.batches import Batch, sample
from drpbench.learning.demonstrations import Demonstrations
from drpbench.learning.learner import Learner
from drpbench.policies.networks.arm import arm_at
from drpbench.policies.networks.chunks import CHUNK, decode, encode, lookahead
from drpbench.policies.networks.lstm_gmm import initial, unrolled
from drpbench.policies.networks.lstm_gmm_format import LstmGmmFormat
from drpbench.policies.networks.lstm_gmm_size import SIZES
from drpbench.robot import PANDA, Robot


@dataclass(frozen=True)
class LstmGmmLearner(LstmGmmFormat, Learner):
    """NeuralMP's architecture, of one size."""

    @classmethod
    def sizes(cls) -> dict[str, Learner]:
        return {name: cls(size) for name, size in SIZES.items()}

    def initial(self, seed: int) -> dict[str, Any]:
        return initial(self.size, seed, self.robot)

    def sample(self, key: PRNGKeyArray, demonstrations: Demonstrations, count: int) -> Batch:
        return sample(key, demonstrations, count, self.size.scene_points, self.robot)

    def loss(self, parameters: Any, batch: Batch, precision: str) -> Float[Array, ""]:
        """-mean log p(action) over samples, and over the control steps of a sequence."""
        joints, action = sequence(batch, self.size.horizon, self.robot)
        goal, points, mask = (
            jnp.repeat(leaf[:, None], self.size.horizon, axis=1)
            for leaf in (batch.goal, batch.scene_points, batch.scene_mask)
        )
        arm = arm_at(joints, self.size.arm_points, self.robot)
        seen = (points, mask, arm, joints, goal)
        mixture = unrolled(self.size, parameters, *seen, dtype=precision, robot=self.robot)
        return -jnp.mean(mixture.log_likelihood(action))


def sequence(
    batch: Batch, horizon: int, robot: Robot = PANDA
) -> tuple[Float[Array, "B H J"], Float[Array, "B H J"]]:
    """Where the arm is [rad] in `horizon` control steps in a row, and the action in each, in the
    units of a chunk's commanded row.

    Raises ValueError where a chunk is too short.
    """
    ahead = lookahead(robot)
    if horizon - 1 + ahead > CHUNK:
        raise ValueError(f"horizon must be 1 to {CHUNK + 1 - ahead}, got {horizon}")
    waypoints = decode(batch.chunk, batch.joints, batch.goal, robot)
    joints = jnp.concatenate([batch.joints[:, None], waypoints[:, : horizon - 1]], axis=1)
    targets = waypoints[:, ahead - 1 : ahead - 1 + horizon]
    rows = jnp.broadcast_to(targets[:, :, None], (*targets.shape[:2], CHUNK, robot.joints))
    goal = jnp.broadcast_to(batch.goal[:, None], joints.shape)
    return joints, encode(rows, joints, goal, robot)[:, :, ahead - 1]
