"""Episodes: a policy in a world, many problems at once."""

from .batch import LANES as LANES
from .batch import Rollout as Rollout
from .batch import Trace as Trace
from .keys import instance_key as instance_key
