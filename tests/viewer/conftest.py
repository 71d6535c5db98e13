"""One simulation that every test of this room begins anew."""

import pytest

from drpbench.envs import TASKS, World
from drpbench.policies import DcpRmp, Straight
from drpbench.problems import load_set
from drpbench.viewer import Simulation

FURNISHED = 23  # a problem of FDO with a cardboard box on the table


@pytest.fixture(scope="session")
def compiled():
    simulation = Simulation(World(TASKS["FDO"]), DcpRmp(Straight()), load_set().task("FDO"))
    list(simulation.compile(FURNISHED))
    return simulation


@pytest.fixture
def simulation(compiled):
    """FDO with the straight line under DCP-RMP, at the start of a furnished problem."""
    compiled.open(FURNISHED)
    return compiled
