"""How long an episode is, and how often a policy is asked."""

from dataclasses import dataclass

CONTROL_PERIOD = 1.0 / 60.0  # [s]
CONTROL_STEPS = 1000  # 16.7 s at 60 Hz


@dataclass(frozen=True)
class Episode:
    """How long an episode is, and how often the policy is asked."""

    steps: int = 1000
    period: float = 1.0 / 60.0  # [s]


EPISODE = Episode()
