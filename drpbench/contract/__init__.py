"""What passes between the rooms: problems, observations, policies, episodes and verdicts. No
physics."""

from .episode import EPISODE as EPISODE
from .episode import PROTOCOL as PROTOCOL
from .episode import Episode as Episode
from .host_policy import HostObservation as HostObservation
from .host_policy import HostPolicy as HostPolicy
from .movers import Movers as Movers
from .movers import no_movers as no_movers
from .observation import OBSERVED as OBSERVED
from .observation import ROBOT_POINTS as ROBOT_POINTS
from .observation import SCENE_POINTS as SCENE_POINTS
from .observation import ArraySpec as ArraySpec
from .observation import Observation as Observation
from .observation import Spec as Spec
from .observation import observation_spec as observation_spec
from .policy import OF_THE_WORLD as OF_THE_WORLD
from .policy import UNSTATED as UNSTATED
from .policy import Policy as Policy
from .policy import Scalar as Scalar
from .problem import WAY_POINTS as WAY_POINTS
from .problem import Problem as Problem
from .sensor import Sensor as Sensor
from .verdict import REACH_ORIENTATION as REACH_ORIENTATION
from .verdict import REACH_POSITION as REACH_POSITION
from .verdict import REACH_POSITION_LOOSE as REACH_POSITION_LOOSE
from .verdict import Measured as Measured
from .verdict import Verdict as Verdict
from .verdict import reached as reached
