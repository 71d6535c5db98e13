"""Shapes and types are checked at run time in every test."""

import pytest
from jaxtyping import install_import_hook

from .browser import ABSENT, CHROMIUM, Browser

install_import_hook(
    [
        "drpbench.robot",
        "drpbench.geometry",
        "drpbench.envs",
        "drpbench.policies",
        "drpbench.baselines",
        "drpbench.learning",
    ],
    "beartype.beartype",
)

# Each of these fixtures compiles a rollout or draws problems with a planner.
SLOW_FIXTURES = {"compiled", "drawn", "finished", "rolled"}


def pytest_collection_modifyitems(items):
    """Marks as slow every test that asks for a slow fixture; other slow tests carry the mark."""
    for item in items:
        if SLOW_FIXTURES & set(getattr(item, "fixturenames", ())):
            item.add_marker(pytest.mark.slow)


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    if CHROMIUM is None:
        pytest.skip(ABSENT)
    with Browser(tmp_path_factory.mktemp("chromium")) as opened:
        yield opened
