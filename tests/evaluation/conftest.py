"""Headers and rows to vary: each fixture is a function taking only what a test cares about."""

import pytest

from ..results import header, result, row


def _marked(policy="rmp", verdicts=None, **changes):
    """verdicts: per task a string, one character an instance: + success, - not, x collided."""
    verdicts = verdicts or {"FDO": "+-x"}
    rows = [
        row(task, id, reached=verdict == "+", collided=verdict == "x")
        for task, marks in verdicts.items()
        for id, verdict in enumerate(marks)
    ]
    return result(policy, rows, **changes)


@pytest.fixture(scope="session")
def make_header():
    return header


@pytest.fixture(scope="session")
def make_row():
    return row


@pytest.fixture(scope="session")
def make_result():
    return _marked
