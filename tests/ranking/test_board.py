import json

import pytest

from drpbench.ranking import LeaderboardError, build, load_dir, measures, wilson
from drpbench.ranking.board import Rate, beside
from drpbench.ranking.statistics import Paired, mcnemar
from drpbench.results import Result, ResultsError, save

EXPECTED = {"SE": 6, "FDO": 3, "GB": 3}


def refusal(results, expected=EXPECTED):
    with pytest.raises(LeaderboardError) as caught:
        build(results, expected)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_every_rate_is_counted_from_the_rows(make_header, make_row):
    rows = [
        make_row(id=0),
        make_row(id=1, collided=True),
        make_row(id=2, reached=False, reached_5cm=True),
    ]
    board = build({"a": Result(header=make_header(), rows=rows)}, EXPECTED)
    cell = board.entries[0].cells["FDO"]
    assert cell.success == Rate(1, 3)
    assert cell.reached == Rate(2, 3)
    assert cell.reached_5cm == Rate(3, 3)
    assert cell.collided == Rate(1, 3)
    assert cell.success.interval == wilson(1, 3)
    assert cell.success.share == 1 / 3


def test_overall_counts_rows_not_tasks(make_result):
    board = build({"a": make_result(verdicts={"SE": "++++--", "FDO": "---"})}, EXPECTED)
    assert board.entries[0].overall.success == Rate(4, 9)
    assert board.tasks == ("SE", "FDO")


def test_tasks_stand_in_the_expected_order(make_result):
    board = build({"a": make_result(verdicts={"GB": "+++", "FDO": "---", "SE": "+"})}, EXPECTED)
    assert board.tasks == tuple(board.entries[0].cells) == ("SE", "FDO", "GB")


def test_policies_are_sorted_by_overall_success(make_result):
    marks = {"b-low": "+--", "high": "+++", "a-low": "-+-"}
    results = {name: make_result(name, {"FDO": verdicts}) for name, verdicts in marks.items()}
    board = build(results, EXPECTED)
    assert [entry.policy for entry in board.entries] == ["high", "a-low", "b-low"]


def test_two_entries_are_compared_on_shared_instances(make_result):
    board = build(
        {
            "a": make_result("a", {"FDO": "+++", "SE": "++++++"}),
            "b": make_result("b", {"FDO": "+-x"}),
            "c": make_result("c", {"SE": "------"}),
        },
        EXPECTED,
    )
    first, second, last = board.entries
    assert first.against(second) == Paired(2, 0, 3, mcnemar(2, 0))
    assert second.against(last).shared == 0  # b ran FDO only and c SE only


def test_fewer_rows_than_problems_is_partial(make_result):
    results = {
        "a": make_result("a", {"SE": "++++++", "FDO": "++"}),
        "b": make_result("b", {"SE": "------", "FDO": "---", "GB": "---"}),
    }
    whole, partial = build(results, EXPECTED).entries
    assert [partial.cells["SE"].partial, partial.cells["FDO"].partial] == [False, True]
    assert partial.overall.partial
    assert not whole.overall.partial
    assert (whole.rank, partial.rank) == (1, None)  # below, whatever it scores


def test_instances_that_do_not_count_are_in_no_denominator(make_header, make_row):
    rows = [make_row("GB", i, reached=i != 1, valid=i != 0) for i in range(20)]
    result = Result(header=make_header(tasks=("GB",)), rows=rows)
    cell = build({"a": result}, {"GB": 20}).entries[0].cells["GB"]
    assert cell.success == cell.reached == Rate(18, 19)
    assert cell.left_out == 1
    assert not cell.partial


def test_a_run_that_left_out_more_than_a_tenth_is_partial(make_header, make_row):
    for left_out, partial in ((2, False), (3, True)):
        rows = [make_row("GB", i, valid=i >= left_out) for i in range(20)]
        result = Result(header=make_header(tasks=("GB",)), rows=rows)
        (entry,) = build({"a": result}, {"GB": 20}).entries
        assert entry.cells["GB"].partial == partial
        assert entry.rank == (None if partial else 1)


def test_light_contacts_deadlines_and_self_collisions_are_counted_apart(make_header, make_row):
    rows = [
        make_row(id=0, success_before_removal=True),
        make_row(id=1, collided=True, min_clearance=-4e-5, success_before_removal=False),
        make_row(id=2, self_collided=True),
    ]
    (entry,) = build({"a": Result(header=make_header(), rows=rows)}, EXPECTED).entries
    cell = entry.cells["FDO"]
    assert (cell.success, cell.light, cell.clean) == (Rate(2, 3), Rate(3, 3), Rate(1, 3))
    assert cell.by_deadline == Rate(1, 2)


def test_two_versions_of_the_protocol_never_stand_together(make_result):
    results = {
        "old": make_result("a", {"FDO": "+++"}, protocol=1),
        "new": make_result("b", {"FDO": "---"}, protocol=2),
    }
    newest = build(results, EXPECTED)
    assert [entry.policy for entry in newest.entries] == ["b"]
    assert (newest.protocol, newest.others) == (2, {1: 1})
    assert [entry.policy for entry in build(results, EXPECTED, 1).entries] == ["a"]
    with pytest.raises(LeaderboardError, match="expected results of protocol 3, got those of 1, 2"):
        build(results, EXPECTED, 3)


def test_a_task_where_nothing_counts_has_no_share(make_header, make_row):
    result = Result(header=make_header(tasks=("GB",)), rows=[make_row("GB", valid=False)])
    entry = build({"a": result}, EXPECTED).entries[0]
    assert entry.cells["GB"].success == Rate(0, 0)
    assert entry.cells["GB"].success.share == 0


def test_files_of_one_policy_on_different_tasks_are_one_entry(make_result):
    board = build(
        {"a": make_result(verdicts={"SE": "++++++"}), "b": make_result(verdicts={"FDO": "+--"})},
        EXPECTED,
    )
    (entry,) = board.entries
    assert entry.overall.success == Rate(7, 9)


@pytest.mark.parametrize(
    "changes", [{}, {"policy_parameters": {"gain": 1.0}}, {"privileged": True}, {"seed": 1}]
)
def test_two_runs_of_one_policy_are_told_apart_by_their_files(make_result, changes):
    board = build({"one.json": make_result(), "two.json.gz": make_result(**changes)}, EXPECTED)
    assert {entry.policy for entry in board.entries} == {"rmp (one)", "rmp (two)"}


def test_a_run_is_called_by_its_name(make_result):
    board = build({"one.json": make_result(), "two.json": make_result(name="mine")}, EXPECTED)
    assert {entry.policy for entry in board.entries} == {"rmp", "mine"}


def test_a_protocol_of_which_there_is_a_whole_run_comes_before_a_newer_one(make_result):
    whole, part = {"SE": "++++++", "FDO": "+--", "GB": "---"}, {"FDO": "+-"}
    results = {
        "old": make_result("a", whole, protocol=1),
        "new": make_result("b", whole, protocol=2),
        "newest": make_result("c", part, protocol=3),
    }
    board = build(results, EXPECTED)
    assert (board.protocol, board.others) == (2, {1: 1, 3: 1})
    del results["old"], results["new"]
    results["older"] = make_result("d", part, protocol=2)
    assert build(results, EXPECTED).protocol == 3  # no run is whole


def test_runs_of_two_seeds_are_not_compared_in_pairs(make_result):
    own = {"a.json": make_result("mine", {"FDO": "++"}, seed=1)}
    assert beside(own, {"rmp.json": make_result("rmp", {"FDO": "--"})}) == {}
    board = build(own | {"b.json": make_result("mine", {"FDO": "+-"})}, EXPECTED)
    assert [line[2:] for line in measures.paired_lines(board)] == [["–"] * 5]


def test_shipped_results_stand_beside_on_the_same_problems(make_result):
    own = {"mine.json": make_result("mine", {"FDO": "++"})}
    shipped = {
        "rmp.json": make_result("rmp", {"SE": "------", "FDO": "+--"}),
        "mine.json": make_result("mine", {"FDO": "---"}),
        "old.json": make_result("old", {"FDO": "---"}, protocol=7),
        "else.json": make_result("else", {"FDO": "---"}, problem_set_sha256="c" * 64),
        "se.json": make_result("se", {"SE": "------"}),
    }
    found = beside(own, shipped)
    assert list(found) == ["shipped: rmp.json", "shipped: mine.json"]
    assert [row.key for row in found["shipped: rmp.json"].rows] == [("FDO", 0), ("FDO", 1)]
    board = build(own | found, EXPECTED)
    assert [entry.policy for entry in board.entries] == ["mine", "rmp", "mine, shipped"]
    lines = [line[:5] for line in measures.paired_lines(board)]
    assert lines == [["mine", "rmp", "1", "0", "2"], ["mine", "mine, shipped", "2", "0", "2"]]


@pytest.mark.parametrize(
    "changes", [{"problem_set": "drpbench-v2"}, {"problem_set_sha256": "b" * 64}]
)
def test_different_problems_are_never_mixed(make_result, changes):
    results = {"one.json": make_result(), "two.json": make_result("straight", **changes)}
    message = refusal(results)
    assert message.startswith("one.json and two.json were made on different problems")
    assert next(iter(changes)) in message


@pytest.mark.parametrize("verdicts", [{"FDO": "++++"}, {"XYZ": "+"}])
def test_a_row_of_no_known_problem_is_refused(make_result, verdicts):
    message = refusal({"one.json": make_result(verdicts=verdicts)})
    assert message.startswith("one.json: drpbench-v1 has no problem ")


def test_no_results_make_no_leaderboard():
    assert refusal({}) == "no result to compare"


def test_a_folder_is_read_by_file_name(tmp_path, make_result):
    save(make_result("straight"), tmp_path / "b.json")
    save(make_result("rmp"), tmp_path / "a.json.gz")
    (tmp_path / "c.json.partial").write_text("a run in progress")
    (tmp_path / "d.json.gz.partial").write_text("another")
    (tmp_path / "README.md").write_text("what these are")
    results = load_dir(tmp_path)
    assert {name: result.header.policy for name, result in results.items()} == {
        "a.json.gz": "rmp",
        "b.json": "straight",
    }


def test_a_damaged_file_is_never_skipped(tmp_path, make_result):
    save(make_result(), tmp_path / "a.json")
    bad = tmp_path / "b.json"
    save(make_result("straight"), bad)
    data = json.loads(bad.read_text())
    data["rows"][1]["success"] = True
    bad.write_text(json.dumps(data))
    with pytest.raises(ResultsError) as caught:
        load_dir(tmp_path)
    assert str(caught.value).startswith(f"{bad}: rows[1]: FDO 1: success must be exactly")


def test_a_damaged_compressed_file_is_never_skipped(tmp_path, make_result):
    save(make_result(), tmp_path / "a.json.gz")
    bad = tmp_path / "b.json.gz"
    bad.write_bytes((tmp_path / "a.json.gz").read_bytes()[:-1])
    with pytest.raises(ResultsError) as caught:
        load_dir(tmp_path)
    assert str(caught.value).startswith(f"{bad}: is not gzip, or damaged (")


def test_a_result_plain_and_compressed_is_named(tmp_path, make_result):
    for name in ("a.json", "b.json", "b.json.gz", "b.c.json.gz"):
        save(make_result(), tmp_path / name)
    with pytest.raises(LeaderboardError) as caught:
        load_dir(tmp_path)
    assert str(caught.value) == f"{tmp_path}: holds both b.json and b.json.gz; remove one"


def test_an_empty_or_missing_folder_says_so(tmp_path):
    with pytest.raises(LeaderboardError, match="holds no result file"):
        load_dir(tmp_path)
    with pytest.raises(LeaderboardError, match="no such folder"):
        load_dir(tmp_path / "none")
    (tmp_path / "a.json").touch()
    with pytest.raises(
        LeaderboardError, match="a.json: expected a folder of result files, got a file"
    ):
        load_dir(tmp_path / "a.json")
