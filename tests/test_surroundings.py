"""What surrounds the program changes no number and ends no run: settings, terminals, disks."""

import io
import os
import subprocess
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from drpbench.cli import terminal
from drpbench.cli.app import at_home
from drpbench.compile import jit
from drpbench.evaluation.machine import environment, processor
from drpbench.results import load

from .few_lanes import DRPBENCH

D = ("run", "--task", "FDO", "--policy", "straight", "--problems", "2")


def drpbench(*arguments, folder=None, limit="", **environ):
    command = [*DRPBENCH, *map(str, arguments)]
    if limit:
        command = ["bash", "-c", f'{limit}; exec "$@"', "bash", *command]
    told = subprocess.run(
        command,
        cwd=folder,
        env=os.environ | {"PYTHONPATH": str(Path(__file__).parents[1])} | environ,
        capture_output=True,
        timeout=600,
    )
    return told.returncode, told.stdout.decode("latin-1"), told.stderr.decode("latin-1")


def drawn(key):
    return jax.random.uniform(key, (4,)) @ jnp.ones((4, 4))


def test_compiled_programs_do_not_see_the_users_settings():
    expected = np.asarray(jit(lambda seed: drawn(jax.random.key(seed)))(3))
    settings = {
        "jax_enable_x64": True,
        "jax_default_prng_impl": "rbg",
        "jax_threefry_partitionable": False,
        "jax_numpy_rank_promotion": "raise",
        "jax_default_matmul_precision": "bfloat16",
    }
    before = {name: getattr(jax.config, name) for name in settings}
    try:
        for name, value in settings.items():
            jax.config.update(name, value)
        found = jit(lambda seed: drawn(jax.random.key(seed)))(np.int32(3))
    finally:
        for name, value in before.items():
            jax.config.update(name, value)
    assert found.dtype == np.float32
    np.testing.assert_array_equal(found, expected)


@pytest.mark.slow
def test_a_run_has_the_same_rows_whatever_is_set(tmp_path):
    assert drpbench(*D, "--out", "a.json", folder=tmp_path)[0] == 0
    settings = {"JAX_ENABLE_X64": "1", "JAX_DEFAULT_PRNG_IMPL": "rbg"}
    settings["JAX_NUMPY_RANK_PROMOTION"] = "raise"
    code, _, errors = drpbench(*D, "--out", "b.json", folder=tmp_path, **settings)
    assert code == 0, errors
    a, b = load(tmp_path / "a.json"), load(tmp_path / "b.json")
    assert a.rows == b.rows
    assert b.header.environment.items() >= settings.items()


def test_the_header_says_what_could_move_a_number(monkeypatch):
    monkeypatch.setenv("XLA_FLAGS", "--xla_cpu_max_isa=AVX2")
    monkeypatch.setenv("JAX_PLATFORMS", "cpu")
    found = environment()
    assert found["XLA_FLAGS"] == "--xla_cpu_max_isa=AVX2" and "JAX_PLATFORMS" not in found
    assert processor()


def test_a_backend_that_is_not_there_is_one_line(tmp_path):
    code, _, errors = drpbench("doctor", JAX_PLATFORMS="cuda")
    assert code == 2 and errors.count("\n") == 1
    assert errors.startswith("drpbench: JAX_PLATFORMS=cuda: expected a device")


def test_a_terminal_that_knows_few_letters_is_no_end():
    code, told, errors = drpbench("list", PYTHONIOENCODING="ascii")
    assert code == 0 and "?+dcp-rmp" in told, errors


def test_names_in_brackets_are_no_markup():
    file = io.StringIO()
    console = terminal.console_of()
    console.file, console.width = file, 80
    console.print("wrote exp [draft]/v[/2]/x.json")
    console.print(terminal.listing({"[bold]": [("[red]a", "[/2]")]}))
    assert "exp [draft]/v[/2]/x.json" in file.getvalue()
    assert "[bold]" in file.getvalue() and "[/2]" in file.getvalue()


def test_the_users_folder_is_found_behind_an_equals_sign():
    assert at_home(["--out=~/x.json"]) == [f"--out={Path.home()}/x.json"]
    assert at_home(["run", "--policy-arg=a=~", "~/y", "--out=./~"]) == [
        "run",
        "--policy-arg=a=~",
        "~/y",
        "--out=./~",
    ]


@pytest.mark.slow
def test_a_full_disk_is_one_line_and_nothing_is_lost(tmp_path):
    arguments = (*D, "--save-trajectories", "--out", "x.json")
    code, _, errors = drpbench(*arguments, folder=tmp_path, limit="ulimit -f 60")
    assert code == 2 and "Traceback" not in errors
    assert "file too large" in errors.splitlines()[-1]
    code, _, errors = drpbench(*arguments, "--resume", folder=tmp_path)
    assert code == 0, errors
    assert len(load(tmp_path / "x.json").rows) == 2


def test_the_version_is_told():
    code, told, _ = drpbench("--version")
    assert code == 0 and told.startswith("drpbench 0.")
