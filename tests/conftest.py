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


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    if CHROMIUM is None:
        pytest.skip(ABSENT)
    with Browser(tmp_path_factory.mktemp("chromium")) as opened:
        yield opened
