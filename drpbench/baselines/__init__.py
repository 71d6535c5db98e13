"""Policies to compare with."""

from .curobo import Curobo as Curobo
from .mppi import Mppi as Mppi
from .ompl import Ompl as Ompl
from .rmp import Rmp as Rmp
from .test_time import TestTimeOptimisation as TestTimeOptimisation
from .trajopt import TrajOpt as TrajOpt
