"""How long an episode is, and how often a policy is asked."""

CONTROL_PERIOD = 1.0 / 60.0  # [s]
CONTROL_STEPS = 1000  # 16.7 s at 60 Hz
