"""Shards: written whole, resumed, added to, and refused when they are not what they should be."""

import json
import subprocess
import sys
from pathlib import Path

import jax
import numpy as np
import pytest

from drpbench.learning.demonstrations import MANIFEST, DataError, Shards, join, read

ROOT = Path(__file__).parents[2]


def part(demonstrations, keep):
    return jax.tree.map(lambda leaf: np.asarray(leaf)[keep], demonstrations)


@pytest.fixture
def folder(tmp_path, demonstrations):
    shards = Shards(tmp_path / "data", "training")
    shards.add(range(8, 16), part(demonstrations, slice(4, 10)))
    shards.add(range(8), part(demonstrations, slice(0, 4)))
    return tmp_path / "data"


def test_what_is_read_is_what_was_written_in_order_of_number(folder, demonstrations):
    expected = part(demonstrations, slice(0, 10))
    for a, b in zip(jax.tree.leaves(read(folder)), jax.tree.leaves(expected), strict=True):
        assert a.dtype == b.dtype and np.array_equal(a, b)


def test_a_shard_has_the_arrays_that_the_format_says(folder, demonstrations):
    """One array a name: shards of earlier versions stay readable."""
    with np.load(folder / "training-000000000.npz") as arrays:
        assert set(arrays.files) == {
            *("index", "family", "kind", "half_size", "position", "quaternion", "mask"),
            *("goal", "path", "length", "reached"),
        }
        assert np.array_equal(arrays["quaternion"], demonstrations.obstacles.quaternion[:4])


def test_another_run_goes_on_where_the_first_stopped(folder, demonstrations):
    shards = Shards(folder, "training")
    assert shards.done == [range(8), range(8, 16)]
    assert shards.counts == {"drawn": 16, "solved": 10, "obstructed": 0}
    shards.add(range(16, 24), part(demonstrations, slice(10, 12)))
    assert read(folder).count == 12


def test_a_damaged_shard_is_named_and_made_anew(folder):
    victim = next(folder.glob("*000000008.npz"))
    victim.write_bytes(victim.read_bytes()[:-1])
    with pytest.raises(DataError, match="000000008.npz is damaged"):
        read(folder)
    assert Shards(folder, "training").done == [range(8)]
    victim.unlink()
    with pytest.raises(DataError, match="is missing"):
        read(folder)


def test_other_data_are_not_mixed_in(folder):
    with pytest.raises(DataError, match="stream 'training', not 'validation'"):
        Shards(folder, "validation")


def test_a_folder_of_something_else_is_left_alone(tmp_path):
    (tmp_path / "thesis.tex").write_text("")
    with pytest.raises(DataError, match="not empty"):
        Shards(tmp_path, "training")
    with pytest.raises(DataError, match="holds no demonstrations"):
        read(tmp_path)


@pytest.mark.parametrize("text", ["", "[]", '{"shards": 3}', '{"shards": {}}'])
def test_a_damaged_manifest_is_one_clear_line(folder, text):
    (folder / MANIFEST).write_text(text)
    with pytest.raises(DataError, match="is damaged"):
        read(folder)


def test_a_newer_format_is_refused(folder):
    manifest = json.loads((folder / MANIFEST).read_text())
    (folder / MANIFEST).write_text(json.dumps(manifest | {"format": 99}))
    with pytest.raises(DataError, match="format 99"):
        read(folder)


def test_joining_keeps_all(demonstrations):
    both = join([part(demonstrations, slice(0, 3)), part(demonstrations, slice(3, 5))])
    assert np.array_equal(both.index, np.asarray(demonstrations.index)[:5])


def test_what_is_missing_of_any_range(folder):
    """There are 0 to 15."""
    shards = Shards(folder, "training")
    assert shards.missing(range(16), 4) == []
    assert shards.missing(range(3, 21), 4) == [range(16, 20), range(20, 21)]
    assert shards.missing(range(20, 23), 100) == [range(20, 23)]
    holes = Shards(folder.parent / "holes", "training")
    assert holes.missing(range(5), 4) == [range(4), range(4, 5)]


def test_the_example_reads_what_is_documented(folder):
    """Every array that a shard has stands in docs/training.md with its shape."""
    example = ROOT / "examples" / "read_demonstrations.py"
    shown = subprocess.run(
        [sys.executable, example, folder], capture_output=True, text=True, check=True
    ).stdout
    lines = shown.splitlines()
    assert lines[-1].startswith("10 paths")
    documented = (ROOT / "docs" / "training.md").read_text()
    for name in (line.split()[0] for line in lines[:-1]):
        assert f"| `{name}` |" in documented
