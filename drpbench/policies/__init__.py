"""The trivial baselines, DCP-RMP, and the networks."""

from . import leaves as leaves
from .dcp_rmp import DcpRmp as DcpRmp
from .dcp_rmp import Reaction as Reaction
from .dynamic_points import squared_distances as squared_distances
from .floors import FoldAndWait as FoldAndWait
from .floors import Hold as Hold
from .floors import Straight as Straight
