"""The world: problems, the simulation step, observations and the five tasks."""

from .contact import Contact as Contact
from .contact import contact as contact
from .dynamics import CONTROL_PERIOD as CONTROL_PERIOD
from .movers import Movers as Movers
from .observation import ROBOT_POINTS as ROBOT_POINTS
from .observation import SCENE_POINTS as SCENE_POINTS
from .observation import Observation as Observation
from .problem import Problem as Problem
from .tasks import CONTROL_STEPS as CONTROL_STEPS
from .tasks import TASKS as TASKS
from .tasks import Task as Task
from .world import Events as Events
from .world import State as State
from .world import World as World
