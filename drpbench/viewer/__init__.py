"""A task as it runs, in the browser: watch a policy, and put things in its way."""

from .moment import Moment as Moment
from .simulation import Simulation as Simulation
