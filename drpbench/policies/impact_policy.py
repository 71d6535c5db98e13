"""IMPACT as a policy: one inference a control step, of which one waypoint is commanded."""

from dataclasses import dataclass, field

import jax

from .chunks import commanded
from .impact import ImpactSize, Parameters, apply


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Impact:
    """The network's chunk at each control step; the servos get its waypoint LOOKAHEAD (`chunks.py`)."""

    parameters: Parameters
    size: ImpactSize = field(metadata={"static": True})
    weights: str = field(default="", metadata={"static": True})
    """Which numbers these are, for a result's header: the SHA-256 of the file they came from, if any."""

    privileged = False

    def init(self, observation):
        return ()

    def act(self, observation, carry, key):
        q, goal = observation.joint_position, observation.goal_joints
        chunk = apply(
            self.size,
            self.parameters,
            observation.scene_points,
            observation.scene_mask,
            observation.robot_points,
            q,
            goal,
        )
        return commanded(chunk, q, goal), carry
