"""When an episode counts as reached."""

import math

REACH_POSITION = 0.01  # [m]
REACH_POSITION_LOOSE = 0.05  # [m] the reference evaluator's
REACH_ORIENTATION = math.radians(15.0)
