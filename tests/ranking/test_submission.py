"""Submitting: what contradicts itself is refused in one line, and a correct result finds its
place."""

import gzip
import json
import re
import sys

import pytest

from drpbench.cli import app as cli
from drpbench.problems import load_set
from drpbench.ranking import load_dir
from drpbench.ranking.submission import assess, check
from drpbench.results import Header, Result, ResultsError, Row, load
from drpbench.results.shipped import shipped_results


@pytest.fixture(scope="module")
def shipped():
    """The baselines' alone: what the best policy's rows say must not move the places below."""
    names = ("hold", "fold-and-wait", "straight")
    results = load_dir(shipped_results())
    return {f"{name}.json.gz": results[f"{name}.json.gz"] for name in names}


@pytest.fixture(scope="module")
def fdo(shipped):
    """The rows of FDO of `straight`, as a run of another policy."""
    return restricted(shipped["straight.json.gz"], ("FDO",), policy="mine")


def restricted(result, tasks, **changes):
    header = result.header.model_dump() | {"tasks": list(tasks), "problems": dict.fromkeys(tasks)}
    rows = [row for row in result.rows if row.task in tasks]
    return Result(header=Header(**(header | changes)), rows=rows)


def edited(result, wanted, **changes):
    """The result with one row changed by hand, the first that `wanted` picks; the schema lets it
    pass."""
    rows = list(result.rows)
    index = next(i for i, row in enumerate(rows) if wanted(row))
    rows[index] = Row(**(rows[index].model_dump() | changes))
    return Result(header=result.header, rows=rows)


@pytest.mark.slow
def test_what_is_shipped_is_correct():
    for name, result in load_dir(shipped_results()).items():
        check(name, result)


@pytest.mark.parametrize(
    ("wanted", "changes", "told"),
    [
        (
            lambda row: not row.reached and not row.collided and row.task == "SE",
            {"success": True, "reached": True, "reached_5cm": True, "reached_once": True}
            | {"time_to_goal": 9.0},
            "reached is true, but the errors at the end are",
        ),
        (
            lambda row: row.success,
            {"success": False, "reached": False, "time_to_goal": None},
            "reached is false, but the errors",
        ),
        (lambda row: row.reached, {"position_error": 0.02}, "0.02 m"),
        (lambda row: row.reached, {"orientation_error": 0.3}, "0.3 rad"),
        (
            lambda row: not row.reached and row.reached_5cm,
            {"reached_5cm": False},
            "reached_5cm is false",
        ),
        (
            lambda row: row.collided and not row.reached,
            {"collided": False, "first_collision_step": None, "first_collision_link": None},
            "min_clearance must be below zero exactly where collided is true",
        ),
        (lambda row: not row.collided, {"min_clearance": -0.001}, "min_clearance"),
        (lambda row: row.collided, {"first_collision_step": 1000}, "1000 of 1000"),
        (lambda row: row.collided, {"first_collision_link": "link0"}, "'link0'"),
        (lambda row: row.reached, {"time_to_goal": 17.0}, "17.0 s of 16.7 s"),
        (lambda row: row.task == "FDO", {"valid": False}, "valid may be false only in SAO, GB"),
        (lambda row: row.family == "table", {"family": "shelf"}, "its family is table, not shelf"),
    ],
)
def test_a_row_edited_by_hand_is_named(shipped, wanted, changes, told):
    result = edited(shipped["fold-and-wait.json.gz"], wanted, **changes)
    with pytest.raises(ResultsError, match=told) as refused:
        check("x.json", result)
    assert str(refused.value).startswith("x.json: ") and "\n" not in str(refused.value)


def test_an_error_that_rounds_to_the_threshold_is_on_either_side(fdo):
    def reached(row):
        return row.reached

    check("x.json", edited(fdo, reached, position_error=0.01))


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"problem_set": "drpbench-v0"}, "the problem set drpbench-v0 does not come with drpbench"),
        (
            {"problem_set_sha256": "0" * 64},
            "made on drpbench-v1 with checksum 0{12}...; the problems here",
        ),
        ({"tasks": ["XYZ"], "problems": {"XYZ": None}}, "no task XYZ; the tasks are SE"),
        ({"problems": {"FDO": [200]}}, "no problem 200 in FDO; ids go from 0 to 199"),
    ],
)
def test_a_header_of_other_problems_is_refused(fdo, changes, told):
    rows = [] if "tasks" in changes else fdo.rows
    if "problems" in changes and rows:
        rows = [Row(**(rows[0].model_dump() | {"id": 200}))]
    result = Result(header=Header(**(fdo.header.model_dump() | changes)), rows=rows)
    with pytest.raises(ResultsError, match=told):
        check("x.json", result)


def test_an_id_out_of_range_is_named(fdo):
    stranger = Row(**(fdo.rows[0].model_dump() | {"id": 200}))
    with pytest.raises(
        ResultsError, match="FDO 200: there is no such problem; ids go from 0 to 199"
    ):
        check("x.json", Result(header=fdo.header, rows=[*fdo.rows, stranger]))


def test_a_whole_run_has_a_place_in_every_task(shipped):
    mine = restricted(shipped["straight.json.gz"], load_set().counts, policy="mine")
    found = assess({"x.json": mine}, shipped)
    places = {standing.task: (standing.place, standing.of) for standing in found.standings}
    # One waits, one is the same, one stands still; ties share a place.
    assert places == dict.fromkeys(("SE", "SAO", "FDO", "GB", "DGB", "All"), (2, 4))
    assert {standing.ahead for standing in found.standings} == {"fold-and-wait"}
    assert found.missing == () and found.notes == ()
    low, high = found.entry.overall.success.interval
    assert low < found.entry.overall.success.share < high


def test_an_entry_again_is_compared_with_the_others_alone(shipped):
    found = assess({"x.json": shipped["fold-and-wait.json.gz"]}, shipped)
    assert [standing.of for standing in found.standings] == [3, 3, 3, 3, 3, 3]
    assert any("fold-and-wait has already" in note for note in found.notes)


def test_what_is_missing_is_said(shipped, fdo):
    few = Result(
        header=Header(**(fdo.header.model_dump() | {"problems": {"FDO": [0, 1]}, "seed": 3})),
        rows=fdo.rows[:2],
    )
    found = assess({"x.json": few}, shipped)
    assert found.missing == (
        "SE: all 3200 problems",
        "SAO: all 300 problems",
        "FDO: 198 of 200 problems",
        "GB: all 200 problems",
        "DGB: all 400 problems",
        "seed 0: this is seed 3, so boxes and points are others",
    )
    assert all(standing.place is None for standing in found.standings)


def test_files_of_one_policy_are_one_entry(shipped):
    parts = {
        f"{task}.json": restricted(shipped["straight.json.gz"], (task,), policy="mine")
        for task in load_set().counts
    }
    found = assess(parts, shipped)
    assert found.missing == () and not found.entry.overall.partial


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"seed": 3}, "two of seed 0 and 3"),
        ({"policy_parameters": {"gain": 2.0}}, "two of policy parameters"),
        ({"tasks": ("FDO",)}, "both of FDO"),
    ],
)
def test_files_of_two_runs_are_refused(shipped, changes, told):
    first, second = (
        restricted(shipped["straight.json.gz"], tasks, policy="mine", **more)
        for tasks, more in (
            (("FDO",), {}),
            (changes.get("tasks", ("DGB",)), {k: v for k, v in changes.items() if k != "tasks"}),
        )
    )
    with pytest.raises(ResultsError, match=f"a.json and b.json: expected one run, .* got {told}"):
        assess({"a.json": first, "b.json": second}, shipped)


def test_a_run_of_its_own_name_is_submitted_as_its_policy(shipped, fdo):
    named = restricted(fdo, ("FDO",), name="the third try")
    assert assess({"x.json": named}, shipped).entry.policy == "mine"
    again = restricted(shipped["fold-and-wait.json.gz"], ("FDO",), name="another")
    found = assess({"x.json": again}, shipped)
    assert found.entry.policy == "fold-and-wait" and any(
        "fold-and-wait has already" in note for note in found.notes
    )


def test_a_result_of_an_older_protocol_is_compared_with_its_like_alone(shipped, fdo):
    newer = {
        name: restricted(one, one.header.tasks, protocol=fdo.header.protocol + 1)
        for name, one in shipped.items()
        if name == "fold-and-wait.json.gz"
    }
    others = {"hold.json.gz": shipped["hold.json.gz"]} | newer
    found = assess({"x.json": fdo}, others)
    was = fdo.header.protocol
    assert f"protocol {was + 1}: this is of protocol {was}, whose scores differ" in found.missing
    assert {standing.of for standing in found.standings if standing.task == "FDO"} == {2}


def test_files_of_two_policies_are_refused(shipped):
    both = {name: shipped[name] for name in ("fold-and-wait.json.gz", "hold.json.gz")}
    with pytest.raises(ResultsError, match="two policies, fold-and-wait and hold"):
        assess(both, shipped)


def test_other_versions_and_privilege_are_noted(shipped, fdo):
    versions = fdo.header.versions | {"jax": "0.11.9"}
    odd = restricted(fdo, ("FDO",), versions=versions, privileged=True)
    notes = "\n".join(assess({"x.json": odd}, shipped).notes)
    assert "jax 0.11.9" in notes and "privileged" in notes


def command(monkeypatch, capsys, *arguments):
    """Exit code, stdout and stderr of `drpbench ...`, in this process."""
    monkeypatch.setattr(sys, "argv", ["drpbench", *map(str, arguments)])
    with pytest.raises(SystemExit) as ended:
        cli.main()
    shown = capsys.readouterr()
    return ended.value.code or 0, " ".join(shown.out.split()), shown.err


def test_the_command_shows_places_and_intervals(monkeypatch, capsys):
    code, shown, _ = command(
        monkeypatch, capsys, "submit", shipped_results() / "fold-and-wait.json.gz"
    )
    assert code == 0
    assert (
        re.search(r"place \d of \d", shown) and "135/200 67.5" in shown and "[60.7, 73.6]" in shown
    )


def test_the_command_ends_with_1_where_something_is_missing(monkeypatch, capsys, fdo, tmp_path):
    from drpbench.results import save

    save(fdo, tmp_path / "mine.json.gz")
    code, shown, _ = command(monkeypatch, capsys, "submit", tmp_path / "mine.json.gz")
    assert code == 1
    assert "SE all 3200 problems" in shown and "FDO place" in shown


@pytest.mark.parametrize(
    "edit", ["cut", "success", "collided", "step", "again", "missing", "family"]
)
def test_a_damaged_file_is_one_line_and_exit_code_2(monkeypatch, capsys, fdo, tmp_path, edit):
    from drpbench.results import save

    path = tmp_path / "mine.json"
    save(fdo, path)
    content = json.loads(path.read_text())
    row = content["rows"][0]
    if edit == "success":
        row["success"] = not row["success"]
    elif edit == "collided":
        row["collided"] = not row["collided"]
    elif edit == "step":
        row["first_collision_step"] = None if row["collided"] else 10
    elif edit == "again":
        content["rows"].append(row)
    elif edit == "missing":
        content["header"]["problems"]["FDO"] = list(range(200))
        content["rows"].pop()
    elif edit == "family":
        row["family"] = "nothing"
    text = json.dumps(content)
    path.write_text(text[: len(text) // 2] if edit == "cut" else text)
    assert edit in ("cut", "family") or _refused_by_the_schema(path)
    for verb in ("submit", "verify"):
        code, _, told = command(monkeypatch, capsys, verb, path)
        assert code == 2 and told.count("\n") == 1 and told.startswith(f"drpbench: {path}: ")


@pytest.mark.parametrize("edit", ["cut", "plain", "sum", "after", "deflate"])
def test_damaged_gzip_is_one_line_and_exit_code_2(monkeypatch, capsys, fdo, tmp_path, edit):
    from drpbench.results import save

    path = tmp_path / "mine.json.gz"
    save(fdo, path)
    whole = path.read_bytes()
    damaged = {
        "cut": whole[: len(whole) // 2],
        "plain": gzip.decompress(whole),
        "sum": whole[:-8] + bytes(8),
        "after": whole + b"more",
        "deflate": whole[:100] + b"\xff" * 100 + whole[200:],
    }
    path.write_bytes(damaged[edit])
    for verb in ("submit", "verify"):
        code, _, told = command(monkeypatch, capsys, verb, path)
        assert code == 2 and told.count("\n") == 1 and told.startswith(f"drpbench: {path}: ")


def _refused_by_the_schema(path):
    with pytest.raises(ResultsError):
        load(path)
    return True
