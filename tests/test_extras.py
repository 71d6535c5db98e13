"""What the core installs is enough to evaluate; another command names the extra that it needs."""

import re
import subprocess
import sys
import tomllib
from importlib.metadata import packages_distributions
from pathlib import Path

import pytest

from drpbench.cli.extras import EXTRAS

PROJECT = tomllib.loads((Path(__file__).parents[1] / "pyproject.toml").read_text())["project"]
BEYOND_CORE = sorted(set().union(*EXTRAS.values()))
FROM_FLAX = {"optax", "orbax"}  # flax, a core dependency, brings these along and imports the first


def without(blocked, *arguments, code="from drpbench.cli import main; main()"):
    """A process in which the packages `blocked` cannot be imported."""
    block = f"import sys; sys.modules.update(dict.fromkeys({list(blocked)!r})); "
    return subprocess.run(
        [sys.executable, "-c", block + code, *arguments],
        capture_output=True,
        text=True,
        timeout=300,
    )


def names(requirements):
    return {re.match(r"[\w.-]+", line)[0].lower().replace("_", "-") for line in requirements}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("extra", "missing", "command"),
    [
        ("train", "mink", "data --out new --count 64"),
        ("train", "optax", "train impact --out new"),
        ("train", "orbax", "train impact --out new"),
        ("train", "mink", "correct weights.safetensors --data data --out new"),
        ("record", "mcap", "replay result.json --id 3"),
        ("record", "mcap", "report --out new.html"),
        ("record", "zstandard", "replay FDO-00003.mcap"),
        ("record", "foxglove_schemas_protobuf", "run --task FDO --problems 1 --record"),
    ],
)
def test_a_command_names_the_extra_that_it_misses(tmp_path, monkeypatch, extra, missing, command):
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parents[1]))
    monkeypatch.chdir(tmp_path)
    refused = without([missing], *command.split())
    assert refused.returncode == 2, refused.stderr
    (line,) = refused.stderr.strip().splitlines()
    assert missing in line and line.endswith(f'pip install "drpbench[{extra}]"')
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
@pytest.mark.parametrize("command", ["list", "leaderboard", "problems show FDO 17", "run --help"])
def test_the_core_needs_no_package_of_an_extra(command):
    done = without(BEYOND_CORE, *command.split())
    assert done.returncode == 0 and done.stdout, done.stderr


@pytest.mark.slow
def test_a_run_with_the_papers_method_needs_no_package_of_an_extra():
    code = (
        "import drpbench.rollout, drpbench.evaluation.referee, drpbench.evaluation.doctor; "
        "from drpbench.plugins.registry import choose; print(choose('drp').policy.privileged)"
    )
    done = without(set(BEYOND_CORE) - FROM_FLAX, code=code)
    assert done.stdout.strip() == "False", done.stderr


@pytest.mark.slow
def test_environments_need_no_package_of_another_extra():
    pytest.importorskip("gymnasium")
    code = "import drpbench.gym, gymnasium; gymnasium.make('drpbench/SE-v1'); print('made')"
    done = without(set(BEYOND_CORE) - FROM_FLAX - {"mink"}, code=code)
    assert done.stdout.strip() == "made", done.stderr


@pytest.mark.parametrize("extra", EXTRAS)
def test_the_extra_installs_what_is_missed(extra):
    declared, core = PROJECT["optional-dependencies"], names(PROJECT["dependencies"])
    installs = names(declared[extra])
    for module in EXTRAS[extra]:
        (package, *_) = (
            name.lower()
            for name in packages_distributions()[module]
            if name.lower() in installs | core
        )
        assert package in installs - core
