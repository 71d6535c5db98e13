"""IMPACT learns: its clouds, and the paper's loss."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from jaxtyping import Array, Float, PRNGKeyArray

from drpbench.learning.batches import Batch, sample
from drpbench.learning.demonstrations import Demonstrations
from drpbench.learning.learner import Learner
from drpbench.learning.loss import chunk_loss, contact_loss
from drpbench.policies.networks.impact import apply, initial
from drpbench.policies.networks.impact_format import ImpactFormat
from drpbench.policies.networks.impact_size import SIZES


@dataclass(frozen=True)
class ImpactLearner(ImpactFormat, Learner):
    """IMPACT of one size."""

    @classmethod
    def sizes(cls) -> dict[str, Learner]:
        return {name: cls(size) for name, size in SIZES.items()}

    def initial(self, seed: int) -> dict[str, Any]:
        return initial(self.size, seed, self.robot)

    def sample(self, key: PRNGKeyArray, demonstrations: Demonstrations, count: int) -> Batch:
        return sample(key, demonstrations, count, self.size.points_seen, self.robot)

    def loss(self, parameters: Any, batch: Batch, precision: str) -> Float[Array, ""]:
        seen = (batch.scene_points, batch.scene_mask, batch.robot_points, batch.joints, batch.goal)
        answer = apply(self.size, parameters, *seen, dtype=precision, robot=self.robot)
        return chunk_loss(batch.chunk, answer) + contact_loss(
            batch.chunk, answer, batch.joints, batch.goal, batch.obstacles, self.robot
        )
