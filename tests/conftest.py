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

# Each of these fixtures compiles a rollout, so every test that asks for one is slow.
COMPILES = {"compiled", "finished", "rolled"}


def pytest_collection_modifyitems(items):
    """Marks as slow what compiles a rollout by a fixture; other slow tests carry the mark."""
    for item in items:
        if COMPILES & set(getattr(item, "fixturenames", ())):
            item.add_marker(pytest.mark.slow)


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    if CHROMIUM is None:
        pytest.skip(ABSENT)
    with Browser(tmp_path_factory.mktemp("chromium")) as opened:
        yield opened
