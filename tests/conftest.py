"""Shapes and types are checked at run time in every test."""

import os
import shutil
import tempfile

import numpy as np
import pytest
from hypothesis import settings
from jaxtyping import install_import_hook

from .browser import ABSENT, CHROMIUM, Browser
from .result_rows import header, result, row

install_import_hook(
    [
        "drpbench.robot",
        "drpbench.contract",
        "drpbench.perception",
        "drpbench.planning",
        "drpbench.geometry",
        "drpbench.envs",
        "drpbench.policies",
        "drpbench.baselines",
        "drpbench.learning",
    ],
    "beartype.beartype",
)

# The same examples every time: what fails by luck fails for somebody else.
settings.register_profile("same", derandomize=True)
settings.load_profile("same")

# Tests run a program once or twice: that does not pay for making it fast.
CHEAP = "--xla_llvm_disable_expensive_passes=true"

# Each of these fixtures compiles a rollout or draws problems with a planner.
SLOW_FIXTURES = {"compiled", "drawn", "figures", "finished", "rolled", "training"}


def pytest_configure(config):
    """Programs are compiled in haste, once for all of a session's processes: its workers, and what
    they run."""
    if CHEAP not in os.environ.get("XLA_FLAGS", ""):
        os.environ["XLA_FLAGS"] = f"{os.environ.get('XLA_FLAGS', '')} {CHEAP}".strip()
    if not hasattr(config, "workerinput") and "DRPBENCH_CACHE" not in os.environ:
        config.compiled = os.environ["DRPBENCH_CACHE"] = tempfile.mkdtemp(prefix="drpbench-tests-")
    from drpbench.compile import use_cache

    use_cache()


def pytest_unconfigure(config):
    if folder := getattr(config, "compiled", None):
        shutil.rmtree(folder, ignore_errors=True)


# Rooms whose tests share what takes a minute to make: one worker has them all.
SHARING = ("recording", "viewer")


def pytest_collection_modifyitems(items):
    """Marks as slow every test that asks for a slow fixture; other slow tests carry the mark. Tests
    of a file stay together, and those of a room that shares."""
    for item in items:
        room = item.path.parent.name
        item.add_marker(pytest.mark.xdist_group(room if room in SHARING else str(item.path)))
        if SLOW_FIXTURES & set(getattr(item, "fixturenames", ())):
            item.add_marker(pytest.mark.slow)


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    if CHROMIUM is None:
        pytest.skip(ABSENT)
    with Browser(tmp_path_factory.mktemp("chromium")) as opened:
        yield opened


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


@pytest.fixture(scope="session")
def spheres():
    from drpbench.generation.generator import CHECKER_MARGIN
    from drpbench.planning.checker import sphere_checker

    return sphere_checker(CHECKER_MARGIN)


@pytest.fixture(scope="session")
def meshes():
    from drpbench.generation.generator import CHECKER_MARGIN
    from drpbench.planning.checker import mesh_checker
    from drpbench.robot import PANDA

    if (model := PANDA.meshes.find()) is None:
        pytest.skip(PANDA.meshes.absent)
    return mesh_checker(model, CHECKER_MARGIN)


@pytest.fixture
def obstacles():
    """The table and obstacles from (kind, half_size, position) triples, none of them turned."""
    from drpbench.geometry import Obstacles

    def make(*extra):
        rows = [(0, (0.9, 1.0, 0.025), (0.4, 0.0, -0.025)), *extra]
        return Obstacles.of(
            np.array([row[0] for row in rows], np.int32),
            np.array([row[1] for row in rows], np.float32),
            np.array([row[2] for row in rows], np.float32),
            np.tile(np.array([1, 0, 0, 0], np.float32), (len(rows), 1)),
        )

    return make


@pytest.fixture(scope="session")
def drawn():
    """Two dozen problems to learn from, of a stream of their own."""
    from drpbench.generation.training_problems import Drawer

    drawer = Drawer("tests")
    return [drawer.draw(number) for number in range(24)]
