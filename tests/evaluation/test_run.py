"""A run is of the problem set it is given, and only that set makes sense of its rows."""

import json
import sys
from dataclasses import replace

import pytest

from drpbench.cli import app as cli
from drpbench.envs import TASKS, World
from drpbench.evaluation import Request, run
from drpbench.evaluation.progress import Silent
from drpbench.evaluation.run import world_of
from drpbench.evaluation.verification import verify
from drpbench.perception import SurfaceCloud
from drpbench.problems import ProblemSetError, load_set
from drpbench.problems.lines import FORMAT
from drpbench.ranking import load_dir
from drpbench.ranking.submission import assess, check
from drpbench.results import ResultsError, save
from drpbench.results.shipped import shipped_results
from drpbench.robot import PANDA
from drpbench.robot.arms import arm

pytestmark = pytest.mark.slow


def write(path, **changes):
    """A set of two problems: the arm is at its goal, once in the open and once inside an
    obstacle."""
    home = PANDA.home.round(4).tolist()
    header = {"format": FORMAT, "name": "mine", "tasks": ["SE"]} | changes
    ball = {"shape": "sphere", "radius": 0.1, "position": [0.31, 0.0, 0.5]}
    problem = {"task": "SE", "start": home, "goal": home, "obstacles": []}
    lines = [header, problem, problem | {"obstacles": [ball], "family": "ball"}]
    path.write_text("".join(f"{json.dumps(line)}\n" for line in lines))
    return load_set(path)


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    return tmp_path_factory.mktemp("sets") / "mine.jsonl"


@pytest.fixture(scope="module")
def mine(file):
    return write(file)


@pytest.fixture(scope="module")
def result(mine, tmp_path_factory):
    out = tmp_path_factory.mktemp("runs") / "mine.json"
    return run(Request(policy="hold", problems={"SE": None}, out=out, problem_set=mine), Silent())


def test_the_header_names_the_set_and_the_rows_are_its_problems(mine, result):
    assert (result.header.problem_set, result.header.problem_set_sha256) == ("mine", mine.sha256)
    assert [(row.id, row.family) for row in result.rows] == [(0, "any"), (1, "ball")]
    assert [row.success for row in result.rows] == [True, False]
    assert result.rows[1].collided and result.rows[0].min_clearance is None


def test_the_rows_are_checked_against_that_set_alone(mine, result, tmp_path):
    check("x.json", result, mine)
    with pytest.raises(ResultsError, match="x.json: the problem set mine does not come with"):
        check("x.json", result)
    other = write(tmp_path / "other.jsonl", ground=False)
    with pytest.raises(ResultsError, match="x.json: made on mine with checksum"):
        check("x.json", result, other)


def test_rows_are_reproduced_with_that_set(mine, result):
    found = verify("x.json", result, 2, 0, Silent(), mine)
    assert (found.rows, found.equal) == (2, 2)


def test_the_leaderboard_says_which_set_it_is_of(mine, result):
    with pytest.raises(
        ResultsError, match=r"x.json: made on mine \(.*; the leaderboard is of drpb"
    ):
        assess({"x.json": result}, load_dir(shipped_results()))
    found = assess({"x.json": result}, {}, mine)
    assert found.missing == () and found.entry.overall.success.k == 1


def test_commands_take_the_set_from_its_file(file, mine, result, tmp_path, monkeypatch, capsys):
    save(result, tmp_path / "x.json")

    def command(*arguments):
        monkeypatch.setattr(sys, "argv", ["drpbench", *map(str, arguments)])
        with pytest.raises(SystemExit) as ended:
            cli.main()
        shown = capsys.readouterr()
        return ended.value.code or 0, shown.out, shown.err

    code, shown, _ = command("leaderboard", tmp_path, "--problems-from", file)
    assert code == 0 and "hold" in shown and "1/2" in shown
    report = tmp_path / "report.html"
    code, *_ = command("report", tmp_path, "--out", report, "--problems-from", file)
    assert code == 0 and "mine" in report.read_text()
    for arguments in (
        ("leaderboard", tmp_path),
        ("report", tmp_path, "--out", report),
        ("verify", tmp_path / "x.json"),
        ("referee", tmp_path / "x.json"),
        ("replay", tmp_path / "x.json", "--id", 0),
    ):
        code, _, told = command(*arguments)
        assert code == 2 and told.count("\n") == 1 and "drpbench: " in told
        assert "--problems-from" in told or "--save-trajectories" in told
    code, _, told = command("submit", tmp_path / "x.json")
    assert code == 2 and "the leaderboard is of drpbench-v1" in told


def test_what_the_set_has_not_is_refused_before_anything_runs(mine, tmp_path):
    for wanted, told in (
        ({"GB": None}, "no task 'GB' in mine; its tasks are SE"),
        ({"SE": [2]}, "no problem 2 in SE; ids go from 0 to 1"),
    ):
        request = Request("hold", wanted, tmp_path / "x.json", problem_set=mine)
        with pytest.raises(ProblemSetError, match=told):
            run(request, Silent())
    assert not list(tmp_path.iterdir())


def test_a_world_has_the_arm_and_the_ground_of_its_set(tmp_path):
    changed = write(tmp_path / "mine.jsonl", ground=False, finger_opening=0.01)
    world = world_of(changed, "SE")
    assert world.robot == arm("panda", 0.01) != PANDA
    assert world.sensor == SurfaceCloud(ground=False)
    assert world_of(load_set(), "SE") == World(TASKS["SE"])


def test_a_task_that_there_is_not_is_named(mine):
    named = replace(mine, problems={"POUR": mine.task("SE")})
    with pytest.raises(ProblemSetError, match="a task POUR, .*; its tasks are SE, SAO"):
        world_of(named, "POUR")
