"""How long an episode is, and how often a policy is asked."""

import math
from dataclasses import dataclass

PROTOCOL = 2
"""Version of what a score means, see docs/protocol.md; rows of two versions are not compared."""
PROTOCOL_RATE = 60.0  # [Hz]; the tasks' times and speeds are given in control steps of this rate


@dataclass(frozen=True)
class Episode:
    """The clock of an episode: `steps` control steps of `period` [s] each.

    The defaults are the protocol's: 60 Hz, 1000 control steps, 16.7 s. Hashable, so static under
    jit. Raises ValueError for an episode without a step or with a period that is no positive
    number.
    """

    steps: int = 1000
    period: float = 1.0 / PROTOCOL_RATE

    def __post_init__(self) -> None:
        if self.steps < 1:
            raise ValueError(f"an episode has at least 1 control step, got {self.steps}")
        if not (math.isfinite(self.period) and self.period > 0.0):
            raise ValueError(f"a control period is a positive number of seconds, got {self.period}")

    @property
    def duration(self) -> float:
        """[s]"""
        return self.steps * self.period

    @property
    def pace(self) -> float:
        """Control steps of the protocol (1/60 s) in one of this episode's; exactly 1 at 60 Hz."""
        return self.period * PROTOCOL_RATE

    def lasting(self, protocol_steps: int) -> int:
        """How many control steps last as long as `protocol_steps` at 60 Hz do, at least 1."""
        return max(1, round(protocol_steps / self.pace))


EPISODE = Episode()
"""The benchmark's."""
