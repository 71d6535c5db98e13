"""Reports are of episodes as they are recorded."""

import pytest

from drpbench.contract import PROTOCOL
from drpbench.problems import load_set
from drpbench.ranking import load_dir
from drpbench.ranking.board import labelled, of_protocol
from drpbench.results.shipped import shipped_results

from ..recording.conftest import header, rolled, stored

__all__ = ["header", "rolled", "stored"]


@pytest.fixture(scope="module")
def shipped():
    return labelled(of_protocol(load_dir(shipped_results()), load_set().counts, PROTOCOL))
