"""The rooms of the package import each other one way only, and hold no heaps."""

import ast
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parents[1] / "drpbench"

# What each room may import besides itself, the package's own name and `drpbench.compile`.
MAY_IMPORT: dict[str, set[str]] = {
    "geometry": set(),
    "robot": set(),
    "contract": {"geometry", "robot"},
    "planning": {"geometry", "robot", "contract"},
    "problems": {"geometry", "robot", "contract", "planning"},
    "generation": {"geometry", "robot", "contract", "planning", "problems"},
    "perception": {"geometry", "robot", "contract"},
    "envs": {"geometry", "robot", "contract", "perception"},
    "policies": {"geometry", "robot", "contract", "planning"},
    "baselines": {"geometry", "robot", "contract", "planning", "policies"},
    "plugins": {"geometry", "robot", "contract", "policies", "baselines"},
    "rollout": {"geometry", "robot", "contract", "problems", "envs", "policies", "plugins"},
    "results": {"contract", "rollout"},
    # Tasks say which of their episodes may be no instance.
    "ranking": {"contract", "robot", "problems", "envs", "results"},
    "evaluation": {
        *("geometry", "robot", "contract", "planning", "problems", "perception", "envs"),
        *("policies", "baselines", "plugins", "rollout", "results", "ranking"),
    },
    "learning": {
        *("geometry", "robot", "contract", "planning", "problems", "generation", "perception"),
        # A network of the user's own is imported as a policy is.
        *("envs", "policies", "plugins", "rollout", "ranking", "evaluation"),
    },
    "recording": {
        *("geometry", "robot", "contract", "problems", "perception", "envs", "policies"),
        *("plugins", "rollout", "results", "ranking", "evaluation"),
    },
    "report": {
        *("geometry", "robot", "contract", "problems", "policies", "plugins", "rollout"),
        *("results", "ranking", "evaluation", "recording"),
    },
    "gym": {
        *("geometry", "robot", "contract", "problems", "generation", "envs", "rollout"),
        *("evaluation", "learning"),
        # Pictures of an environment are those of recordings.
        "recording",
        "perception",
    },
    "viewer": {
        *("geometry", "robot", "contract", "planning", "problems", "perception", "envs"),
        *("policies", "plugins", "rollout", "evaluation", "recording"),
    },
}
FOR_ALL = {"compile", "errors", "__version__"}
LONGEST = 450  # lines; a longer file holds two concepts


def imported(source, module, is_package=False):
    """Dotted names under `drpbench` that a module's source imports, at any depth.

    `from a import b` gives "a.b". `module` is the source's own dotted name.
    """
    names = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            names.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            origin = node.module or ""
            if node.level:
                # One dot is the package the module lies in, and each further dot one above it.
                parts = module.split(".")
                above = parts[: len(parts) - node.level + is_package]
                origin = ".".join([*above, origin] if origin else above)
            names.update(f"{origin}.{alias.name}" for alias in node.names)
    return {name for name in names if name.split(".")[0] == "drpbench"}


def offences(source, module, is_package=False):
    """The imports in a module's source that its room does not allow."""
    room = module.split(".")[1] if "." in module else ""
    if room not in MAY_IMPORT:
        return set()  # the command line and the package's face, above all rooms
    allowed = MAY_IMPORT[room] | FOR_ALL | {room}
    return {
        name
        for name in imported(source, module, is_package)
        if (name.split(".") + [""])[1] not in allowed
    }


def modules():
    """(path, dotted name, whether it is a package) of every module."""
    for path in sorted(PACKAGE.rglob("*.py")):
        parts = ["drpbench", *path.relative_to(PACKAGE).with_suffix("").parts]
        is_package = parts[-1] == "__init__"
        yield path, ".".join(parts[:-1] if is_package else parts), is_package


def test_every_room_is_known():
    rooms = {path.name for path in PACKAGE.iterdir() if (path / "__init__.py").is_file()}
    assert rooms and rooms == {*MAY_IMPORT, "cli"}


@pytest.mark.parametrize("room", MAY_IMPORT)
def test_a_room_imports_only_the_rooms_below_it(room):
    found = {
        name: offences(path.read_text(), name, is_package)
        for path, name, is_package in modules()
        if f"{name}.".startswith(f"drpbench.{room}.")
    }
    assert not {name: sorted(wrong) for name, wrong in found.items() if wrong}


def test_rooms_form_no_circle():
    seen = set()
    for room, below in MAY_IMPORT.items():
        assert below <= seen
        seen.add(room)


@pytest.mark.parametrize(
    ("source", "module", "is_package"),
    [
        ("from drpbench.envs import World", "drpbench.robot.body_points", False),
        ("import drpbench.results.schema", "drpbench.envs.world", False),
        ("import drpbench.policies as p", "drpbench.geometry", True),
        ("from drpbench import problems", "drpbench.policies.floors", False),
        ("from ..envs import World", "drpbench.policies.floors", False),
        ("from ..evaluation import run", "drpbench.problems", True),
        ("from .. import robot", "drpbench.geometry.distance", False),
        ("from ...policies import Hold", "drpbench.envs.tasks.static", False),
        ("def f():\n    from drpbench.cli import main", "drpbench.evaluation.run", False),
        ("from drpbench.envs import World", "drpbench.baselines.rmp", False),
        ("from drpbench.envs.world import Observation", "drpbench.contract.policy", False),
        ("import drpbench", "drpbench.robot.arms.panda", False),
        ("from drpbench.learning import batches", "drpbench.policies.networks.impact", False),
    ],
)
def test_a_wrong_import_is_noticed(source, module, is_package):
    assert offences(source, module, is_package)


@pytest.mark.parametrize(
    ("source", "module", "is_package"),
    [
        ("from drpbench.robot import LINKS", "drpbench.envs.world", False),
        ("from .panda import LINKS", "drpbench.robot", True),
        ("from ..movers import Movers", "drpbench.envs.tasks.static", False),
        ("from . import rotation", "drpbench.problems", True),
        ("from drpbench.compile import jit", "drpbench.robot.robot", False),
        ("from drpbench import __version__", "drpbench.results.schema", False),
        ("import jax, drpbench.policies", "drpbench.evaluation.run", False),
        ("from drpbench.contract import Observation", "drpbench.policies.floors", False),
        ("from drpbench.evaluation import run", "drpbench.cli", False),
        ("import numpy", "drpbench.geometry.distance", False),
    ],
)
def test_a_right_import_passes(source, module, is_package):
    assert not offences(source, module, is_package)


def test_no_module_is_called_utils():
    assert not [path for path in PACKAGE.rglob("*") if path.stem in ("util", "utils")]


def test_no_file_holds_two_concepts():
    lengths = {path: len(path.read_text().splitlines()) for path, *_ in modules()}
    assert not {path.name: n for path, n in lengths.items() if n > LONGEST}
