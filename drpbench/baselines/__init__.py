"""Policies to compare with."""

from .rmp import Rmp as Rmp
