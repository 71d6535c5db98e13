"""A small package around a policy of one's own, to begin with: `drpbench new-policy NAME`."""

import importlib.util
import keyword
import re
from pathlib import Path
from string import Template

from drpbench.contract import ArraySpec, Spec, observation_spec

from .errors import PolicyError

_FILES = {
    "pyproject.toml": """\
[build-system]
requires = ["hatchling"]
build-backend = "hatchling.build"

[project]
name = "$name"
version = "0.1.0"
description = "A policy for drpbench."
readme = "README.md"
requires-python = ">=3.11"
dependencies = ["numpy"]

# What makes `drpbench run --policy $name` find it.
[project.entry-points."drpbench.policies"]
$name = "$module.policy:$class_"

[tool.hatch.build.targets.wheel]
packages = ["$module"]
""",
    "README.md": """\
# $name

A policy for drpbench.

    pip install -e .
    drpbench run --task FDO --problems 20 --policy $name
    drpbench run --task FDO --problems 20 --policy $name --policy-arg gain=0.2
    drpbench run --task FDO --problems 20 --policy $name+dcp-rmp
    python -m pytest

The policy is `$module/policy.py`. For PyTorch tensors instead of NumPy arrays, give the class the attribute
`arrays = "torch"`; for a policy inside JAX's jit, see docs/your-policy.md of drpbench.
""",
    "$module/__init__.py": '''\
"""A policy for drpbench."""
''',
    "$module/policy.py": '''\
"""The policy `$name`."""

import numpy as np


class $class_:
    """A share of the way to the goal, at every step, and never more than `most` radians."""

    def __init__(self, gain: float = 0.1, most: float = 0.05):
        """What may be given on the command line: --policy-arg gain=0.2. Load your network here."""
        self.gain, self.most = gain, most

    def reset(self, observation):
        """New episodes begin, B = len(observation.joint_position) of them: forget the old ones."""

    def act(self, observation):
        """Absolute joint position targets (B, $joints) [rad] for the next control step.

        What an observation has, with B instances in front:

$fields
        """
        away = observation.goal_joints - observation.joint_position
        return observation.joint_position + np.clip(self.gain * away, -self.most, self.most)
''',
    "tests/test_policy.py": '''\
"""The policy answers what the benchmark asks for."""

from types import SimpleNamespace

import numpy as np

from $module.policy import $class_


def test_targets_are_one_short_step_towards_the_goal():
    rng = np.random.default_rng(0)
    here, goal = rng.uniform(-1.0, 1.0, (2, 5, $joints)).astype(np.float32)
    observation = SimpleNamespace(joint_position=here, goal_joints=goal)
    policy = $class_()
    policy.reset(observation)
    targets = policy.act(observation)
    assert targets.shape == (5, $joints)
    assert (np.abs(goal - targets) <= np.abs(goal - here)).all()
    assert (np.abs(targets - here) <= policy.most + 1e-6).all()
''',
}


def write(name: str, folder: Path, taken: frozenset[str], spec: Spec | None = None) -> list[Path]:
    """Writes the package `folder/name`; returns its files. `spec` is of what its policy will see.

    Raises PolicyError for a name that is none, is `taken` by a policy of drpbench or by a module,
    or whose folder stands there already.
    """
    module = name.replace("-", "_")
    if not re.fullmatch(r"[a-z][a-z0-9]*([-_][a-z0-9]+)*", name) or keyword.iskeyword(module):
        raise PolicyError(
            f"expected small letters, digits and single dashes, as in my-policy, got {name!r}"
        )
    if name in taken:
        raise PolicyError(f"{name!r} is a policy of drpbench already; choose another name")
    if importlib.util.find_spec(module):
        raise PolicyError(f"{name!r}: there is a module {module} already; choose another name")
    root = folder / name
    spec = spec or observation_spec()
    words = {
        "name": name,
        "module": module,
        "class_": module.title().replace("_", ""),
        "joints": str(*spec["joint_position"].shape),
        "fields": "\n".join(_line(field, of) for field, of in spec.items()),
    }
    files = {
        root / Template(path).substitute(words): Template(text).substitute(words)
        for path, text in _FILES.items()
    }
    try:
        root.mkdir(parents=True)
        for path, text in files.items():
            path.parent.mkdir(exist_ok=True)
            path.write_text(text, encoding="utf-8")
    except FileExistsError:
        raise PolicyError(f"{root}: exists; nothing overwritten. Choose another name") from None
    except OSError as error:
        raise PolicyError(f"{root}: cannot be written ({error.strerror})") from None
    return list(files)


def _line(name: str, of: ArraySpec) -> str:
    """A field of the observation, as a line of a docstring."""
    shape = ", ".join(["B", *map(str, of.shape)])
    kind = f"[{of.unit}]" if of.unit else of.dtype.name
    return f"        {name:<16} {f'({shape})':<13} {kind:<8} {of.meaning}"
