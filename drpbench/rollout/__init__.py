"""Episodes: a policy in a world, many problems at once."""

from .batch import LANES as LANES
from .batch import Rollout as Rollout
from .batch import Trace as Trace
from .batch import take as take
from .keys import instance_key as instance_key
