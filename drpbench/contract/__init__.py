"""What passes between the rooms: problems, observations, policies, episodes and verdicts. No physics."""

from .episode import CONTROL_PERIOD as CONTROL_PERIOD
from .episode import CONTROL_STEPS as CONTROL_STEPS
from .episode import EPISODE as EPISODE
from .episode import Episode as Episode
from .movers import Movers as Movers
from .movers import no_movers as no_movers
from .observation import ROBOT_POINTS as ROBOT_POINTS
from .observation import SCENE_POINTS as SCENE_POINTS
from .observation import Observation as Observation
from .policy import Policy as Policy
from .policy import Scalar as Scalar
from .problem import Problem as Problem
from .verdict import REACH_ORIENTATION as REACH_ORIENTATION
from .verdict import REACH_POSITION as REACH_POSITION
from .verdict import REACH_POSITION_LOOSE as REACH_POSITION_LOOSE
from .verdict import Measured as Measured
from .verdict import Verdict as Verdict
from .verdict import reached as reached
