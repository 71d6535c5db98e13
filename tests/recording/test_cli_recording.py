"""The commands of this room: what they take, and how they say no."""

import sys

import pytest

from drpbench.cli import app as cli
from drpbench.cli.recording import parse_count, with_all
from drpbench.errors import InputError
from drpbench.results import save

pytestmark = pytest.mark.slow


@pytest.mark.parametrize(
    ("given", "meant"),
    [
        (["run", "--record"], ["run", "--record", "all"]),
        (["run", "--record", "--seed", "1"], ["run", "--record", "all", "--seed", "1"]),
        (["run", "--record", "5"], ["run", "--record", "5"]),
        (["run", "--record=5"], ["run", "--record=5"]),
        (["list"], ["list"]),
    ],
)
def test_record_alone_means_all(given, meant):
    assert with_all(given) == meant


def test_a_count_is_a_number_above_zero():
    assert parse_count("5") == 5 and parse_count("all") is None and parse_count(None) is None
    for wrong in ("0", "-1", "five", "1.5"):
        with pytest.raises(InputError, match="--record"):
            parse_count(wrong)


def _drpbench(monkeypatch, capsys, *arguments):
    """Exit code, and what stood on stderr."""
    monkeypatch.setattr(sys, "argv", ["drpbench", *map(str, arguments)])
    with pytest.raises(SystemExit) as exit:
        cli.main()
    return exit.value.code, capsys.readouterr().err


@pytest.mark.parametrize("name", ["run.json", "run.json.gz"])
def test_replay_writes_beside_the_result(stored, monkeypatch, capsys, name):
    result, path = stored
    path = path.with_name(name)
    save(result, path)
    code, _ = _drpbench(monkeypatch, capsys, "replay", path, "--id", 17)
    assert code == 0
    assert [p.name for p in path.with_name("run").iterdir()] == ["FDO-00017.mcap"]


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ([], "--id 17"),
        (["--id", "3", "--grid", "2"], "--id 17"),
        (["--id", "4"], "no FDO 4; it has 3, 17, 150"),
        (["--id", "3", "--task", "SE"], "no SE; it has: FDO"),
        (["--grid", "0"], "1 to 3"),
    ],
)
def test_bad_input_is_one_line_and_exit_code_2(stored, monkeypatch, capsys, arguments, said):
    result, path = stored
    save(result, path)
    code, error = _drpbench(monkeypatch, capsys, "replay", path, *arguments)
    assert code == 2 and said in error and error.count("\n") == 1
    assert not path.with_suffix("").exists()
