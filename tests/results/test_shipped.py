"""The results that come with drpbench: found, packed small, and in the wheel."""

import gzip
import zipfile
from pathlib import Path

import pytest

from drpbench.ranking import load_dir
from drpbench.results import load, save, shipped
from drpbench.results.shipped import shipped_results

ROOT = Path(__file__).parents[2]


def test_they_are_found_in_a_checkout_and_in_an_installed_package(tmp_path, monkeypatch):
    package = tmp_path / "drpbench"
    monkeypatch.setattr(shipped, "__file__", str(package / "results" / "shipped.py"))
    (package / "results").mkdir(parents=True)  # a folder of code, not of results
    assert shipped_results() == tmp_path / "results"
    (package / "results" / "shipped").mkdir()
    assert shipped_results() == package / "results" / "shipped"


def test_they_are_compressed_as_save_does_it(tmp_path):
    files = sorted((ROOT / "results").iterdir())
    assert [file.name for file in files] == sorted(load_dir(ROOT / "results"))
    for file in files:
        assert file.name.endswith(".json.gz"), f"pack it: gzip -9n {file}"
        save(load(file), tmp_path / "again.json")
        assert gzip.decompress(file.read_bytes()) == (tmp_path / "again.json").read_bytes()


def test_the_wheel_holds_them_where_they_are_looked_for(tmp_path):
    wheel = pytest.importorskip("hatchling.builders.wheel")
    (built,) = wheel.WheelBuilder(str(ROOT)).build(directory=str(tmp_path), versions=["standard"])
    with zipfile.ZipFile(built) as file:
        packed = {name for name in file.namelist() if name.endswith(".json.gz")}
    names = [file.name for file in (ROOT / "results").iterdir()]
    assert packed == {f"drpbench/results/shipped/{name}" for name in names}
