"""Running rows again: which, with what policy, and what the comparison says."""

import sys

import pytest

from drpbench.cli import app as cli
from drpbench.evaluation import rerun
from drpbench.evaluation.progress import Silent
from drpbench.evaluation.run import KEPT
from drpbench.evaluation.verification import sample, verify
from drpbench.plugins.errors import PolicyError
from drpbench.ranking import load_dir
from drpbench.results import Header, Result, ResultsError, Row, save
from drpbench.results.shipped import shipped_results


@pytest.fixture(scope="module")
def shipped():
    return load_dir(shipped_results())


@pytest.fixture(scope="module")
def fdo(shipped):
    """Rows of `straight` on FDO, a few of each verdict, none of them by a hair."""
    rows = [r for r in shipped["straight.json.gz"].rows if r.task == "FDO"]
    clear = [row for row in rows if abs(row.min_clearance) > 0.01]
    few = [row for row in clear if row.success][:4] + [row for row in clear if row.collided][:4]
    few = sorted(few, key=lambda row: row.id)
    header = shipped["straight.json.gz"].header.model_dump()
    header |= {"tasks": ["FDO"], "problems": {"FDO": [row.id for row in few]}}
    return Result(header=Header(**header), rows=few)


@pytest.fixture
def again(monkeypatch):
    """Lets `verify` see the rows it is given here instead of running them; the requests are
    kept."""
    requests = []

    def answers(result):
        def run(request, progress):
            requests.append(request)
            wanted = {(task, id) for task, ids in request.problems.items() for id in ids}
            changes = {
                "tasks": list(request.problems),
                "problems": {task: list(ids) for task, ids in request.problems.items()},
            }
            header = Header(**(result.header.model_dump() | changes))
            return Result(header=header, rows=[row for row in result.rows if row.key in wanted])

        monkeypatch.setattr(rerun, "run", run)
        return requests

    return answers


def changed(result, index, **changes):
    rows = list(result.rows)
    rows[index] = Row(**(rows[index].model_dump() | changes))
    return Result(header=result.header, rows=rows)


@pytest.mark.slow
def test_rows_run_again_have_the_same_verdict(fdo):
    found = verify("x.json", fdo, 8, 0, Silent())
    assert found.rows == 8 and found.reproduced
    # The shipped rows are of another build: what differs is rounding.
    errors = [d for d in found.differences if d.field in ("position_error", "orientation_error")]
    assert all(difference.amount < 1e-3 for difference in errors)


def test_the_same_rows_are_equal_to_the_bit(fdo, again):
    again(fdo)
    found = verify("x.json", fdo, 50, 0, Silent())
    assert (found.rows, found.equal, found.differences) == (8, 8, ())


def test_differences_are_counted_by_row_and_field(fdo, again):
    again(fdo)
    edited = changed(fdo, 2, min_clearance=fdo.rows[2].min_clearance * 1.5, sparc_joint=None)
    found = verify("x.json", edited, 50, 0, Silent())
    assert found.equal == 7 and found.reproduced
    assert {d.field for d in found.differences} == {"min_clearance", "sparc_joint"}
    amounts = {d.field: d.amount for d in found.differences}
    assert amounts["min_clearance"] == pytest.approx(abs(fdo.rows[2].min_clearance) / 2)
    assert amounts["sparc_joint"] is None


def invented(fdo):
    """A success where there was a collision, so well edited that no field contradicts another."""
    index = next(i for i, row in enumerate(fdo.rows) if row.collided)
    return changed(
        fdo,
        index,
        success=True,
        reached=True,
        reached_5cm=True,
        reached_once=True,
        collided=False,
        first_collision_step=None,
        first_collision_link=None,
        min_clearance=0.02,
        position_error=0.001,
        orientation_error=0.01,
        time_to_goal=5.0,
    )


def test_an_invented_success_is_found(fdo, again):
    again(fdo)
    found = verify("x.json", invented(fdo), 50, 0, Silent())
    assert not found.reproduced
    assert {d.field for d in found.turned} >= {"success", "collided"}


def test_rows_are_drawn_by_the_seed(shipped):
    result = shipped["rmp.json.gz"]
    drawn = sample(result, 50, 0)
    assert sum(map(len, drawn.values())) == 50
    assert list(drawn) == [task for task in result.header.tasks if task in drawn]
    assert all(ids == sorted(set(ids)) for ids in drawn.values())
    assert drawn == sample(result, 50, 0) != sample(result, 50, 1)


def test_it_runs_as_it_was_run(fdo, again):
    changes = {"policy_parameters": {"speed": 0.25}, "seed": 7, "batch_size": 3}
    header = Header(**(fdo.header.model_dump() | changes))
    requests = again(Result(header=header, rows=fdo.rows))
    verify("x.json", Result(header=header, rows=fdo.rows), 5, 0, Silent())
    (request,) = requests
    assert (request.policy, request.seed, request.batch_size) == ("straight", 7, 3)
    assert list(request.policy_arguments) == ["speed=0.25"]
    assert len(request.problems["FDO"]) == 5


@pytest.mark.parametrize("name", ["rmp.json.gz", "straight+dcp-rmp.json.gz", "hold.json.gz"])
def test_a_policy_with_its_usual_parameters_needs_no_argument(shipped, again, name):
    requests = again(shipped[name])
    verify(name, shipped[name], 5, 0, Silent())
    assert list(requests[0].policy_arguments) == []


def test_the_inner_policys_parameter_is_set_again(shipped, again):
    header = shipped["straight+dcp-rmp.json.gz"].header
    stated = header.policy_parameters | {"policy.speed": 0.25}
    header = Header(**(header.model_dump() | {"policy_parameters": stated}))
    result = Result(header=header, rows=shipped["straight+dcp-rmp.json.gz"].rows)
    requests = again(result)
    verify("x.json", result, 5, 0, Silent())
    assert list(requests[0].policy_arguments) == ["speed=0.25"]


@pytest.mark.parametrize(
    ("name", "parameters", "told"),
    [
        ("straight+dcp-rmp", {"constants.k_p": 1.0}, "constants.k_p 1.0, and is 100.0 here"),
        ("straight", {"strength": 1.0}, "strength"),
    ],
)
def test_a_parameter_that_cannot_be_set_again_is_named(shipped, again, name, parameters, told):
    result = shipped[f"{name}.json.gz"]
    stated = result.header.policy_parameters | parameters
    header = Header(**(result.header.model_dump() | {"policy_parameters": stated}))
    requests = again(result)
    with pytest.raises(ResultsError, match=told) as refused:
        verify("x.json", Result(header=header, rows=result.rows), 5, 0, Silent())
    assert str(refused.value).startswith("x.json: ") and not requests


def test_a_policy_that_is_privileged_only_here_or_there_is_named(fdo, again):
    again(fdo)
    header = Header(**(fdo.header.model_dump() | {"privileged": True}))
    with pytest.raises(ResultsError, match="privileged True, and is False here"):
        verify("x.json", Result(header=header, rows=fdo.rows), 5, 0, Silent())


def test_a_remote_policy_is_asked_where_it_runs(fdo, again):
    header = Header(**(fdo.header.model_dump() | {"policy": "remote:127.0.0.1:1"}))
    result = Result(header=header, rows=fdo.rows)
    requests = again(result)
    assert verify("x.json", result, 5, 0, Silent()).equal == 5
    assert list(requests[0].policy_arguments) == []


def test_a_policy_lost_on_the_way_leaves_nothing_to_resume(fdo, monkeypatch):
    def run(request, progress):
        raise PolicyError(f"the policy process has ended{KEPT}")

    monkeypatch.setattr(rerun, "run", run)
    with pytest.raises(PolicyError) as error:
        verify("x.json", fdo, 5, 0, Silent())
    assert str(error.value) == "the policy process has ended"


def test_a_result_without_rows_is_refused(fdo):
    empty = Result(
        header=Header(**(fdo.header.model_dump() | {"problems": {"FDO": None}})), rows=[]
    )
    with pytest.raises(ResultsError, match=r"x\.json: holds no row"):
        verify("x.json", empty, 5, 0, Silent())


def test_other_software_is_named(fdo, again):
    again(fdo)
    versions = fdo.header.versions | {"jax": "0.9.0"}
    header = Header(**(fdo.header.model_dump() | {"versions": versions, "device": "a GPU"}))
    found = verify("x.json", Result(header=header, rows=fdo.rows), 5, 0, Silent())
    now = fdo.header.versions["jax"]
    assert f"jax 0.9.0 then, {now} now" in found.elsewhere
    assert any(line.startswith("device a GPU then") for line in found.elsewhere)


@pytest.mark.parametrize(
    ("make", "name", "code"),
    [(lambda fdo: fdo, "x.json", 0), (invented, "x.json", 1), (invented, "x.json.gz", 1)],
)
def test_the_exit_code_is_the_verdict(fdo, again, make, name, code, monkeypatch, capsys, tmp_path):
    again(fdo)
    save(make(fdo), tmp_path / name)
    monkeypatch.setattr(sys, "argv", ["drpbench", "verify", str(tmp_path / name)])
    with pytest.raises(SystemExit) as ended:
        cli.main()
    shown = capsys.readouterr().out
    assert (ended.value.code or 0) == code
    assert f"{8 - code} of 8 rows are equal in every field" in shown
    assert ("every verdict is the same: 8 of 8" if code == 0 else "another verdict") in shown


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["verify", "nowhere.json"], "nowhere.json: cannot be read"),
        (["verify", "x.json", "--sample", "0"], "--sample 0: must be at least 1"),
        (["verify", "x.json", "--seed", "-1"], "--seed -1: must not be negative"),
    ],
)
def test_bad_arguments_are_one_line_and_exit_code_2(arguments, told, monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["drpbench", *arguments])
    with pytest.raises(SystemExit) as ended:
        cli.main()
    shown = capsys.readouterr().err
    assert ended.value.code == 2 and told in shown and shown.count("\n") == 1
