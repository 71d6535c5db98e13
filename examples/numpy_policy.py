"""A host policy in NumPy: an ordinary class, asked for a whole batch of instances at each control
step.

drpbench run --task FDO --problems 20 --policy examples.numpy_policy:Approach --policy-arg gain=0.2
"""

import numpy as np


class Approach:
    """A share of the way to the goal, at every step, and never more than `most` radians."""

    def __init__(self, gain: float = 0.1, most: float = 0.05):
        self.gain, self.most = gain, most

    def reset(self, observation):
        """New episodes begin: forget the old ones. B = len(observation.joint_position)."""

    def act(self, observation):
        """Absolute joint position targets (B, 7) [rad]."""
        away = observation.goal_joints - observation.joint_position
        return observation.joint_position + np.clip(self.gain * away, -self.most, self.most)
