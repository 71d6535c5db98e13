"""The policy protocol, the two floors, and DCP-RMP."""

from .dcp_rmp import DcpRmp as DcpRmp
from .dcp_rmp import Reaction as Reaction
from .dynamic_points import squared_distances as squared_distances
from .floors import SERVO_LAG as SERVO_LAG
from .floors import Hold as Hold
from .floors import Straight as Straight
from .policy import Policy as Policy
from .policy import Scalar as Scalar
