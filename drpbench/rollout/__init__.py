"""Episodes: a policy in a world, many problems at once."""

from .batch import LANES as LANES
from .batch import Rollout as Rollout
