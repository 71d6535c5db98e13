"""A run in parts, and the whole of them."""

import subprocess

import pytest

from drpbench.errors import InputError
from drpbench.results import Result, ResultsError, load, save
from drpbench.results.shards import merged, parse, share

from ..few_lanes import DRPBENCH
from ..result_rows import header, row

COUNTS = {"FDO": 7, "SE": 20}
OTHER = header().versions | {"jax": "9.9"}
WHOLE = Result(
    header=header(tasks=("FDO", "SE"), problems={"FDO": None, "SE": [4, 1, 9, 2]}),
    rows=[
        *(row("FDO", id, reached=id % 2 == 0) for id in range(7)),
        *(row("SE", id, collided=id > 3) for id in (1, 2, 4, 9)),
    ],
)


def part(number, of, whole=WHOLE, **changes):
    problems = share(whole.header.problems, COUNTS, number, of)
    rows = [one for one in whole.rows if one.id in problems[one.task]]
    update = {"problems": problems, "shard": f"{number}/{of}", **changes}
    return Result(header=whole.header.model_copy(update=update), rows=rows)


def parts(of, **changes):
    return {f"{n}.json": part(n, of, **changes) for n in range(1, of + 1)}


@pytest.mark.parametrize("of", [1, 2, 3, 4])
def test_all_parts_are_the_bytes_of_one_run(of, tmp_path):
    found = dict(reversed(parts(of).items()))
    save(merged(found, COUNTS), tmp_path / "merged.json")
    save(WHOLE, tmp_path / "whole.json")
    assert (tmp_path / "merged.json").read_bytes() == (tmp_path / "whole.json").read_bytes()


def test_times_add_up_and_every_machine_is_named():
    found = parts(2)
    for number, (name, one) in enumerate(found.items()):
        changes = {
            "wall_seconds": 2.0,
            "device": f"cpu {number}",
            "created": f"2025-01-0{2 - number}T00:00:00+00:00",
        }
        found[name] = Result(header=one.header.model_copy(update=changes), rows=one.rows)
    whole = merged(found, COUNTS).header
    assert whole.wall_seconds == 4.0 and whole.created.startswith("2025-01-01")
    assert whole.device == "cpu 0 + cpu 1" and whole.platform == "Linux"


def test_a_part_may_be_there_twice_if_it_is_the_same():
    assert merged(parts(2) | {"again.json": part(2, 2)}, COUNTS) == merged(parts(2), COUNTS)


def other_rows():
    one = part(2, 2)
    rows = [one.rows[0].model_copy(update={"position_error": 0.005}), *one.rows[1:]]
    return Result(header=one.header, rows=rows)


@pytest.mark.parametrize(
    ("results", "said"),
    [
        ({"a.json": WHOLE}, r"a.json: expected a part of a run \(run --shard 3/16\), got a whole"),
        ({"a.json": part(1, 1, shard="2/1")}, "a.json: expected a part from 1 to 1, got 2/1"),
        ({"a.json": part(1, 3)}, "expected all 3 parts, got none of 2/3, 3/3"),
        ({"a.json": part(1, 2), "b.json": part(2, 3)}, "a.json and b.json: .* of 2 and of 3"),
        ({"a.json": part(1, 2), "b.json": part(2, 2, seed=1)}, "two of seed 0 and 1"),
        ({"a.json": part(1, 2), "b.json": part(2, 2, protocol=2)}, "two of protocol 1 and 2"),
        ({"a.json": part(1, 2), "b.json": part(2, 2, versions=OTHER)}, "two of versions"),
        (parts(2) | {"b.json": other_rows()}, "2.json and b.json: both are part 2/2.*on FDO 1"),
        ({"a.json": part(1, 2), "b.json": part(1, 2, shard="2/2")}, "got a problem of FDO twice"),
        ({"a.json": part(1, 2), "b.json": part(2, 3, shard="2/2")}, "a.json: expected as many"),
    ],
)
def test_what_is_no_run_is_refused(results, said):
    with pytest.raises(ResultsError, match=said) as raised:
        merged(results, COUNTS)
    assert "\n" not in str(raised.value)


def test_parts_are_every_so_many_problems():
    assert parse("3/16") == (3, 16)
    assert share({"SE": None}, COUNTS, 2, 3) == {"SE": [1, 4, 7, 10, 13, 16, 19]}
    assert share({"SE": [4, 1, 9]}, COUNTS, 1, 2) == {"SE": [4, 9]}


@pytest.mark.parametrize("text", ["0/4", "5/4", "3", "a/b", "1/0", "-1/4", "slurm"])
def test_what_is_no_part_is_refused(text, monkeypatch):
    monkeypatch.delenv("SLURM_ARRAY_TASK_ID", raising=False)
    with pytest.raises(InputError, match=f"--shard {text}: expected"):
        parse(text)


def test_more_parts_than_problems_are_refused():
    with pytest.raises(InputError, match="--shard 1/9: FDO has 7 problems for 9 parts"):
        share({"FDO": None}, COUNTS, 1, 9)


def test_slurms_arrays_may_begin_anywhere(monkeypatch):
    for name, value in (("ID", "7"), ("MIN", "5"), ("COUNT", "4")):
        monkeypatch.setenv(f"SLURM_ARRAY_TASK_{name}", value)
    assert parse("slurm") == (3, 4)


@pytest.mark.slow
def test_a_run_in_parts_is_the_run(tmp_path):
    def drpbench(*arguments):
        return subprocess.run(
            [*DRPBENCH, *arguments],
            cwd=tmp_path,
            capture_output=True,
            text=True,
        )

    run = ["run", "--task", "FDO", "--policy", "straight", "--problems", "5"]
    for arguments in ([], ["--shard", "1/2"], ["--shard", "2/2"]):
        done = drpbench(*run, *arguments)
        assert done.returncode == 0, done.stderr
    names = [f"runs/straight-FDO-shard-{n}-of-2.json" for n in (1, 2)]
    merging = ["merge", *names, "--out", "whole.json"]
    assert "5 rows in whole.json" in drpbench(*merging).stdout
    whole, once = load(tmp_path / "whole.json"), load(tmp_path / "runs" / "straight-FDO.json")
    times = {"created": "", "wall_seconds": 0.0}
    assert whole.rows == once.rows
    assert whole.header.model_copy(update=times) == once.header.model_copy(update=times)
    again = drpbench(*merging)
    assert again.returncode == 2 and "whole.json: exists" in again.stderr
    assert "none of 2/2" in drpbench("merge", names[0], "--out", "half.json").stderr
    assert not (tmp_path / "half.json").exists()
