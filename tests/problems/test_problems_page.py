"""docs/problems.md: the file that it shows is a problem set, and its snippet runs."""

import re
from pathlib import Path

import numpy as np

from drpbench.problems import export_lines, load_set
from drpbench.problems.lines import _HEADER, _PROBLEM, FORMAT

PAGE = (Path(__file__).parents[2] / "docs" / "problems.md").read_text()


def block(language):
    (found,) = re.findall(rf"```{language}\n(.*?)```", PAGE, re.DOTALL)
    return found


def test_the_file_shown_is_a_problem_set(tmp_path):
    path = tmp_path / "mine.jsonl"
    path.write_text(block("json"))
    mine = load_set(path)
    assert (mine.name, mine.counts, mine.ground) == ("mine", {"SE": 2}, True)
    problems = mine.task("SE")
    assert problems.obstacles.mask.tolist() == [[True, True], [True, False]]
    assert problems.family == ["any", "ball"]
    again = tmp_path / "again.jsonl"
    again.write_text("".join(f"{line}\n" for line in export_lines(mine)))
    assert np.array_equal(load_set(again).task("SE").goal_quaternion, problems.goal_quaternion)


def test_every_field_is_described():
    for field in (*_HEADER, *_PROBLEM):
        assert f"`{field}`" in PAGE
    assert f"`{FORMAT}`" in PAGE


def test_the_snippet_runs(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    names = {}
    exec(block("python"), names)
    assert names["batch"].goal.shape == (1, 7)
    np.testing.assert_allclose(names["batch"].goal[0, 0] - names["batch"].start[0, 0], 0.5)
