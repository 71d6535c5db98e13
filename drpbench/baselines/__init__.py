"""Policies to compare with."""

from .rmp import Rmp as Rmp
from .trajopt import TrajOpt as TrajOpt
