"""Policies to compare with."""

from .curobo import Curobo as Curobo
from .mppi import Mppi as Mppi
from .ompl import Ompl as Ompl
from .rmp import Rmp as Rmp
from .trajopt import TrajOpt as TrajOpt
