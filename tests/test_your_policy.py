"""What docs/your-policy.md promises: its snippets, the examples, and `drpbench new-policy`, as a
user meets them."""

import importlib
import importlib.util
import json
import os
import re
import shlex
import subprocess
import sys
import time
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from typer.testing import CliRunner

import drpbench.evaluation
from drpbench.cli.app import app
from drpbench.contract import OBSERVED
from drpbench.plugins.host import HANDED, answered
from drpbench.plugins.registry import choose

from .scenes import observation, postures

ROOT = Path(__file__).parents[1]
PAGE = (ROOT / "docs" / "your-policy.md").read_text()
SNIPPETS = dict(re.findall(r"```python\n# file: (\w+)\.py\n(.*?)```", PAGE, re.DOTALL))
COMMANDS = [
    line.split("#")[0].strip()
    for block in re.findall(r"```bash\n(.*?)```", PAGE, re.DOTALL)
    for line in block.splitlines()
]
EXAMPLES = sorted(path.stem for path in (ROOT / "examples").glob("*_policy.py"))
COMPILES = 400  # [s] generous


@pytest.fixture
def written(tmp_path, monkeypatch):
    """The page's snippets as files in the current directory."""
    for name, source in SNIPPETS.items():
        (tmp_path / f"{name}.py").write_text(source)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", list(sys.path))
    yield tmp_path
    for name in SNIPPETS:
        sys.modules.pop(name, None)


@pytest.fixture(scope="module")
def seen():
    """What five arms show, as JAX arrays."""
    q = postures(10)
    each = [observation(a, b) for a, b in zip(q[:5], q[5:], strict=True)]
    return jax.tree.map(lambda *leaves: jnp.stack(leaves), *each)


def answers(policy, seen):
    """The targets of a JAX policy or of a host policy's, whichever it is."""
    if hasattr(policy, "init"):
        return np.asarray(jax.vmap(lambda o: policy.act(o, policy.init(o), None)[0])(seen))
    handed, _ = HANDED[getattr(policy, "arrays", "numpy")](seen, 5, policy)
    policy.reset(handed)
    return answered(policy.act(handed), 5, 7)


def needs_torch(source):
    if "import torch" in source and not importlib.util.find_spec("torch"):
        pytest.skip("PyTorch is not installed")


@pytest.mark.parametrize(
    ("module", "name"),
    [("my_policy", "MyPolicy"), ("my_network", "MyNetwork"), ("my_jax_policy", "Creep")],
)
def test_the_pages_policies_move_the_arm(written, seen, module, name):
    needs_torch(SNIPPETS[module])
    policy = choose(f"{module}:{name}").policy
    targets = answers(getattr(policy, "policy", policy), seen)
    here = np.asarray(seen.joint_position)
    assert targets.shape == (5, 7) and np.isfinite(targets).all()
    assert (np.abs(targets - here).max(axis=1) > 1e-4).all()
    assert set(SNIPPETS) == {"my_policy", "my_network", "my_jax_policy"}


@pytest.mark.parametrize("module", EXAMPLES)
def test_every_example_answers_as_the_one_in_jax(monkeypatch, seen, module):
    assert len(EXAMPLES) == 4
    source = (ROOT / "examples" / f"{module}.py").read_text()
    needs_torch(source)
    monkeypatch.syspath_prepend(ROOT)
    policy = importlib.import_module(f"examples.{module}").Approach()
    reference = importlib.import_module("examples.jax_policy").Approach()
    np.testing.assert_allclose(answers(policy, seen), answers(reference, seen), atol=1e-6)
    if module != "remote_policy":
        assert len(source.splitlines()) <= 30


@pytest.mark.parametrize("command", [c for c in COMMANDS if c.startswith("drpbench run")])
def test_every_command_of_the_page_is_understood(written, monkeypatch, command):
    asked = []

    def instead(request, progress):
        asked.append(request)
        raise KeyboardInterrupt

    monkeypatch.setattr(drpbench.evaluation, "run", instead)
    CliRunner().invoke(app, shlex.split(command)[1:])
    (request,) = asked
    assert request.policy in command
    if not request.policy.startswith("remote:"):
        choice = choose(request.policy, request.policy_arguments)
        for given in request.policy_arguments:
            name, value = given.split("=")
            assert choice.parameters[name] == float(value)


def test_the_page_names_every_field_and_every_kind_of_failure():
    table = PAGE.split("## What it sees")[1].split("## What it answers")[0]
    assert set(re.findall(r"^\| `(\w+)`", table, re.MULTILINE)) == {*OBSERVED, "obstacles"}
    sources = "".join(
        (ROOT / "drpbench" / "plugins" / name).read_text() for name in ("host.py", "remote.py")
    )
    kinds = set(re.findall(r'Failed\(\s*f?"(\w+): ', sources))
    told = set(re.findall(r"\| `(\w+): ", PAGE.split("## What counts as failure")[1]))
    assert kinds == told >= {"raised", "timeout", "shape", "answer", "disconnected"}


def drpbench_command(*arguments, cwd, path=""):
    environment = os.environ | {"PYTHONPATH": os.pathsep.join([str(path), str(ROOT)])}
    return subprocess.run(
        [sys.executable, "-m", "drpbench", *map(str, arguments)],
        cwd=cwd,
        env=environment,
        capture_output=True,
        text=True,
        timeout=COMPILES,
    )


@pytest.mark.slow
def test_a_new_policy_installs_and_runs_as_it_is(tmp_path):
    made = drpbench_command("new-policy", "own-idea", cwd=tmp_path)
    assert made.returncode == 0 and "own_idea/policy.py" in made.stdout
    target = tmp_path / "installed"
    pip = [sys.executable, "-m", "pip", "install", "--quiet", "--no-index", "--no-deps"]
    options = ["--no-build-isolation", "--target", str(target), str(tmp_path / "own-idea")]
    subprocess.run([*pip, *options], check=True, timeout=120)
    tests = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "own-idea/tests"]
    subprocess.run(
        tests, cwd=tmp_path, check=True, timeout=120, env=os.environ | {"PYTHONPATH": str(target)}
    )
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    listed = drpbench_command("list", cwd=elsewhere, path=target)
    assert "own-idea" in listed.stdout and "own_idea.policy:OwnIdea" in listed.stdout
    run = ["run", "--task", "FDO", "--problems", "2", "--policy", "own-idea", "--out", "r.json"]
    done = drpbench_command(*run, "--policy-arg", "gain=0.2", cwd=elsewhere, path=target)
    assert done.returncode == 0, done.stderr
    result = json.loads((elsewhere / "r.json").read_text())
    assert [row["status"] for row in result["rows"]] == ["ok", "ok"]
    assert result["header"]["policy_parameters"]["gain"] == 0.2
    assert all(row["position_error"] < 0.01 for row in result["rows"])  # it does go there


@pytest.mark.parametrize(
    "name", ["rmp", "remote", "My_Policy", "a b", "class", "json", "../up", ""]
)
def test_a_name_that_is_none_is_refused_in_one_line(tmp_path, name):
    refused = CliRunner().invoke(app, ["new-policy", name, "--folder", str(tmp_path)])
    assert type(refused.exception).__name__ == "PolicyError"
    assert "\n" not in str(refused.exception) and not list(tmp_path.iterdir())


def test_new_policy_overwrites_nothing(tmp_path):
    for expected in (None, "PolicyError"):
        done = CliRunner().invoke(app, ["new-policy", "own-idea", "--folder", str(tmp_path)])
        assert done.exception is None or type(done.exception).__name__ == expected
    assert "exists; nothing overwritten" in str(done.exception)


HANGS = """
import time, threading
class Hangs:
    made = 0
    def __init__(self):
        Hangs.made += 1
        self.first = Hangs.made == 1
    def reset(self, observation): self.step = 0
    def act(self, observation):
        self.step += 1
        if self.first and self.step == 5:
            threading.Event().wait()  # for ever
        return observation.joint_position
"""


@pytest.mark.slow
def test_a_policy_that_hangs_for_ever_fails_its_batch_and_the_program_ends(tmp_path):
    (tmp_path / "own_hangs.py").write_text(HANGS)
    run = ["run", "--task", "FDO", "--problems", "2", "--batch-size", "1", "--out", "r.json"]
    began = time.monotonic()
    done = drpbench_command(
        *run, "--policy", "own_hangs:Hangs", "--time-limit", "0.5", cwd=tmp_path
    )
    assert done.returncode == 0, done.stderr
    assert time.monotonic() - began < COMPILES / 2
    rows = json.loads((tmp_path / "r.json").read_text())["rows"]
    assert [row["status"] for row in rows] == ["timeout: act took longer than 0.5 s", "ok"]
    assert "1 of 2 failed: timeout: act took longer than 0.5 s" in done.stdout


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--policy", "own_nothing:Policy"], "no module 'own_nothing'"),
        (["--policy", "own_hangs:Nobody"], "its classes: Hangs"),
        (["--policy", "own_hangs:time"], "a class, or a function"),
        (["--policy", "hold", "--policy-arg", "speed=1"], "no such parameter; it has: none"),
        (["--policy", "straight", "--policy-arg", "speed=fast"], "type float"),
        (["--policy", "remote:127.0.0.1:1"], "nobody answers there"),
        (["--policy", "hold", "--time-limit", "0"], "--time-limit 0"),
    ],
)
def test_bad_input_is_refused_before_anything_is_written(tmp_path, monkeypatch, arguments, said):
    (tmp_path / "own_hangs.py").write_text(HANGS)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", list(sys.path))
    refused = CliRunner().invoke(app, ["run", "--task", "FDO", "--problems", "2", *arguments])
    sys.modules.pop("own_hangs", None)
    assert type(refused.exception).__name__ in ("PolicyError", "InputError")
    assert said in str(refused.exception) and "\n" not in str(refused.exception)
    assert not list(tmp_path.rglob("*.json*"))
