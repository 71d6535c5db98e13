"""The world: the simulation step and the five tasks."""

from .arm import Arm as Arm
from .contact import Contact as Contact
from .contact import contact as contact
from .tasks import TASKS as TASKS
from .tasks import Task as Task
from .world import Events as Events
from .world import State as State
from .world import World as World
