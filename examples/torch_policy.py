"""A host policy in PyTorch: tensors in, tensors out, without gradients. Needs `pip install
"drpbench[torch]"`.

drpbench run --task FDO --problems 20 --policy examples.torch_policy:Approach --policy-arg gain=0.2
"""

import torch


class Approach:
    """A share of the way to the goal, at every step, and never more than `most` radians."""

    arrays = "torch"  # the tensors are JAX's own memory where both sit on one device

    def __init__(self, gain: float = 0.1, most: float = 0.05, device: str = "cpu"):
        self.gain, self.most = gain, most
        self.device = torch.device(
            device
        )  # where the tensors are put; left out: where JAX has them
        # Here: self.network = torch.load(...).to(self.device).eval()

    def reset(self, observation):
        """New episodes begin: forget the old ones. B = len(observation.joint_position)."""

    def act(self, observation):
        """Absolute joint position targets (B, 7) [rad]."""
        away = observation.goal_joints - observation.joint_position
        return observation.joint_position + (self.gain * away).clamp(-self.most, self.most)
