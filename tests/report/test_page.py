"""The report: its figures against the rows, and its HTML without a browser."""

import base64
import io
import json
from html.parser import HTMLParser
from pathlib import PurePath

import numpy as np
import pytest
from PIL import Image
from typer.testing import CliRunner

from drpbench.cli.app import app
from drpbench.problems import load_set
from drpbench.ranking import build, load_dir, wilson
from drpbench.recording import RecordingError, Replay
from drpbench.recording.container import MAGIC
from drpbench.report.figures import (
    CLEARANCES,
    COLLIDED,
    DEPTHS,
    ERRORS,
    FAILED,
    LEFT,
    NOT_REACHED,
    TIMES,
    cell,
    figures,
    reason,
)
from drpbench.report.page import render, write_report
from drpbench.report.pictures import SIZE, _wanted, pictures, telling
from drpbench.report.recordings import Kept, kept
from drpbench.results import save
from drpbench.results.shipped import shipped_results

from ..result_rows import result, row
from .shown import EXPECTED, HOSTILE, some_results

VOID = {"meta", "link", "input", "br"}


class Page(HTMLParser):
    """Open tags must be closed; keeps the text of each table's cells and of each script."""

    def __init__(self, html):
        super().__init__()
        self.open, self.tags, self.tables, self.scripts, self.links = [], [], [], [], []
        self.feed(html)
        self.close()

    def handle_starttag(self, tag, attributes):
        self.tags.append(tag)
        self.links += [value for name, value in attributes if name in ("src", "href")]
        if tag not in VOID:
            self.open.append(tag)
        match tag:
            case "table":
                self.tables.append([])
            case "tr":
                self.tables[-1].append([])
            case "th" | "td":
                self.tables[-1][-1].append("")
            case "script":
                self.scripts.append("")

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if "script" in self.open:
            self.scripts[-1] += data
        elif self.open and {"th", "td"} & set(self.open):
            self.tables[-1][-1][-1] += data


def test_the_figures_of_the_shipped_results_are_their_rows_counted_one_by_one(shipped):
    drawn = figures(build(shipped, load_set().counts), shipped, PurePath("x"), {}, {})
    assert sum(c["n"] for c in drawn["cells"]) == sum(
        r.valid for f in shipped.values() for r in f.rows
    )
    for c in drawn["cells"][::3]:
        policy, task = drawn["policies"][c["policy"]]["name"], drawn["tasks"][c["task"]]
        rows = [
            r
            for f in shipped.values()
            for r in f.rows
            if f.header.policy == policy and r.task == task and r.valid
        ]
        k = sum(r.success for r in rows)
        assert c["success"] == pytest.approx([k, len(rows), *wilson(k, len(rows))], abs=1e-6)
        assert [sum(f[1] for f in c["families"]), sum(f[2] for f in c["families"])] == [
            k,
            len(rows),
        ]
        assert c["times"][-1] == k
        for j in (10, 40, 77):
            steps = [round(60 * r.time_to_goal) for r in rows if r.success]
            assert c["times"][j] == sum(step <= 10 * j for step in steps)
            assert c["errors"][j] == sum(
                r.position_error is not None and r.position_error < ERRORS[j] for r in rows
            )
            assert c["depths"][j] == sum(
                r.reached and (not r.collided or -r.min_clearance <= DEPTHS[j]) for r in rows
            )
        below_zero = sum(c["clearances"][: int(np.argmin(np.abs(CLEARANCES))) + 1])
        assert below_zero == sum(r.collided for r in rows)
        assert sum(c["clearances"]) == sum(r.min_clearance is not None for r in rows)


def test_failures_are_listed_with_their_reason_and_the_command_that_shows_them():
    results = some_results()
    failures = figures(build(results, EXPECTED), results, PurePath("a b"), {}, {})["failures"]
    columns = failures["columns"]
    found = zip(columns["policy"], columns["task"], columns["id"], columns["reason"], strict=True)
    assert list(found) == [
        (0, 1, 2, COLLIDED),
        *((1, 0, i, NOT_REACHED) for i in range(4)),
        (1, 1, 0, COLLIDED),
        (1, 1, 1, FAILED),
    ]
    assert failures["replays"] == [
        "drpbench replay 'a b/good.json'",
        """drpbench replay 'a b/it'"'"'s.json'""",
    ]
    assert [columns["replay"][i] for i in (0, 1)] == [0, 1]
    assert (columns["step"][0], failures["links"][columns["link"][0]]) == (30, "hand")
    assert columns["position"][1] == 3000 and columns["orientation"][1] == 57
    assert failures["statuses"][columns["status"][-1]] == HOSTILE


def test_rows_that_are_not_valid_stand_in_no_figure():
    rows = [row(id=0), row(id=1, valid=False), row(id=2, reached=False, valid=False)]
    results = {"a": result("a", rows)}
    drawn = figures(build(results, EXPECTED), results, PurePath(), {}, {})
    assert drawn["cells"][0]["n"] == drawn["cells"][0]["clearances"][8 + 1] == 1
    assert drawn["failures"]["columns"]["id"] == []


def test_a_row_that_failed_to_run_stays_in_every_denominator():
    fields = {"position_error": None, "min_clearance": None, "status": "nan"}
    drawn = cell([row(), row(id=1, reached=False, **fields)])
    assert drawn["n"] == 2 and drawn["times"][-1] == 1 == drawn["errors"][-1]
    assert len(drawn["times"]) == len(TIMES) and len(drawn["errors"]) == len(ERRORS)


def test_the_reason_is_the_first_that_holds():
    assert reason(row(reached=False, collided=True, status="nan")) == FAILED
    assert reason(row(reached=False, collided=True, reached_once=True)) == COLLIDED
    assert reason(row(reached=False, reached_once=True)) == LEFT
    assert reason(row(reached=False)) == NOT_REACHED


def test_the_page_is_whole_needs_nothing_else_and_says_what_the_leaderboard_says():
    page = Page(render(some_results(), EXPECTED))
    assert not page.open and page.links == ["data:,"]
    assert page.tables[0][0] == ["#", "Policy", "SE", "FDO", "All"]
    assert [line[1] for line in page.tables[0][1:]] == ["good", HOSTILE + "†"]
    assert page.tables[0][1][2] == "100 [51.0, 100]4/4"
    assert page.tables[0][1][3] == "66.7 [20.8, 93.9]2/3"


def test_what_result_files_say_is_text_and_nothing_else():
    html = render(some_results(), EXPECTED)
    page = Page(html)
    assert len(page.scripts) == 2 and html.count("<script>throw") == 0
    assert html.count("<!--") == 0
    data = json.loads(page.scripts[0])
    assert data["policies"][1] == {"name": HOSTILE, "privileged": True}


def test_the_command_writes_the_report_and_refuses_another_ending(tmp_path):
    for name, found in some_results().items():
        save(found, tmp_path / "results" / name)
    out = tmp_path / "new" / "report.html"
    told = CliRunner().invoke(app, ["report", str(tmp_path / "results"), "--out", str(out)])
    assert told.exit_code == 0 and f"wrote {out}" in told.output
    assert f"drpbench replay {tmp_path}/results/good.json" in out.read_text()
    assert [path.name for path in out.parent.iterdir()] == ["report.html"]
    wrong = CliRunner().invoke(app, ["report", "--out", str(tmp_path / "results" / "good.json")])
    assert "must end in .html" in str(wrong.exception)


def test_shipped_results_stand_in_the_report_beside_a_folder(tmp_path):
    """On the problems that both have, and with the command that replays them where they lie."""
    shipped = load_dir(shipped_results())
    name, one = next((n, r) for n, r in shipped.items() if "FDO" in r.header.tasks)
    rows = [r for r in one.rows if r.task == "FDO"][:20]
    changes = {"tasks": ["FDO"], "problems": {"FDO": [r.id for r in rows]}, "policy": "mine"}
    mine = one.model_copy(update={"header": one.header.model_copy(update=changes), "rows": rows})
    for checkpoint in (1, 2):
        save(mine, tmp_path / "runs" / f"at-{checkpoint}.json")

    def page(*more):
        out = tmp_path / "report.html"
        told = CliRunner().invoke(app, ["report", str(tmp_path / "runs"), "--out", str(out), *more])
        assert told.exit_code == 0, told.exception
        return Page(out.read_text())

    own = {"mine (at-1)", "mine (at-2)"}
    beside, alone = page(), page("--alone")
    names = {line[1].removesuffix("†") for line in beside.tables[0][1:]}
    assert own < names and one.header.policy in names
    assert {line[1] for line in alone.tables[0][1:]} == own
    assert {line[2].rpartition("]")[2].partition("/")[2] for line in beside.tables[0][1:]} <= {"20"}
    data = json.loads(beside.scripts[0])
    assert f"drpbench replay {shipped_results() / name}" in data["failures"]["replays"]
    (paired,) = (table for table in beside.tables if table[0][:2] == ["Policy", "against"])
    assert ["mine (at-1)", one.header.policy, "0", "0", "20"] in [line[:5] for line in paired]


def test_the_report_is_of_one_protocol_and_says_what_it_leaves_out():
    old, new = some_results()["good.json"], some_results()["it's.json"]
    header = new.header.model_copy(update={"protocol": 2})
    new = new.model_copy(update={"header": header, "rows": new.rows[:-1]})  # no whole run
    results = {"old.json": old, "new.json": new}
    html = render(results, EXPECTED)
    assert "protocol 1." in html and "1 result is of protocol 2 and left out" in html
    assert "protocol 2." in render(results, EXPECTED, protocol=2)


def test_pictures_are_of_each_of_two_runs_of_a_policy(tmp_path):
    results = {
        f"{name}.json": result("mine", [row("SE", i, reached=False) for i in range(4)])
        for name in ("a", "b")
    }
    wanted = list(_wanted(results, tmp_path, 2, True, pytest.fail))
    assert [name for name, _ in wanted] == ["a.json"] * 2 + ["b.json"] * 2


def test_what_lies_beside_a_result_is_found_and_moves_with_the_report(tmp_path):
    folder = tmp_path / "a b" / "good"
    folder.mkdir(parents=True)
    (folder / "FDO-00002.mcap").write_bytes(2 * MAGIC)
    (folder / "FDO-00004.mcap").write_bytes(MAGIC + b"half")
    (folder / "FDO-2.mcap").write_bytes(2 * MAGIC)
    for name in ("FDO-00002.mp4", "SE-00001.webp", "SE-grid-4.mp4"):
        (folder / name).touch()
    for name in ("FDO-00003.txt", ".FDO-00003.1.tmp.mp4", "notes.mp4"):
        (folder / name).touch()
    found = kept(folder, tmp_path)
    assert found.address == "a%20b/good"
    assert found.episodes == {("FDO", 2): [0, 2], ("SE", 1): [1]}
    assert found.grids == ["SE-grid-4.mp4"]
    assert kept(folder, tmp_path / "a b" / "pages").address == "../good"
    assert kept(tmp_path / "none", tmp_path) == Kept()


@pytest.mark.parametrize("form", [".json", ".json.gz"])
def test_the_written_page_links_to_recordings(tmp_path, form):
    (tmp_path / "good").mkdir()
    (tmp_path / "good" / "FDO-00002.mcap").write_bytes(2 * MAGIC)
    results = {name.replace(".json", form): found for name, found in some_results().items()}
    write_report(tmp_path / "report.html", results, EXPECTED, tmp_path)
    data = json.loads(Page((tmp_path / "report.html").read_text()).scripts[0])
    places = data["failures"]["columns"]
    ((place, kinds),) = data["gallery"]["kept"]
    assert (places["replay"][place], places["id"][place]) == (0, 2)
    assert [data["gallery"]["kinds"][kind] for kind in kinds] == [".mcap"]
    assert data["gallery"]["folders"] == ["good", ""]


def test_telling_failures_are_of_all_kinds():
    rows = [row("SE", i, collided=True) for i in range(5)] + [row("SE", 5)]
    rows += [row("SE", 6, reached=False), row("FDO", 9, reached=False)]
    rows += [row("FDO", 3, reached=False, valid=False), row("FDO", 4, reached=False, status="nan")]
    assert [(r.task, r.id) for r in telling(rows[::-1], 5)] == [
        ("FDO", 9),
        ("SE", 0),
        ("SE", 6),
        ("SE", 1),
        ("SE", 2),
    ]
    assert telling(rows, 0) == [] and len(telling(rows, 99)) == 7


@pytest.fixture
def failed(stored):
    """A stored result of which no row is a success, and the path of its file."""
    found, path = stored
    rows = [r.model_copy(update={"success": False}) for r in found.rows]
    assert any(r.collided for r in rows)
    return found.model_copy(update={"rows": rows}), path


def test_pictures_are_small_and_show_the_contact(failed):
    found, path = failed
    drawn = pictures({"run.json": found}, path.parent, 9, False, pytest.fail)
    assert {id for _, _, id in drawn} == {r.id for r in found.rows}
    for one in found.rows:
        kind, _, text = drawn["run.json", "FDO", one.id].partition(",")
        assert kind == "data:image/webp;base64" and len(text) < 12_000
        picture = Image.open(io.BytesIO(base64.b64decode(text)))
        assert picture.size == SIZE
        red, green, blue = np.asarray(picture.convert("RGB"), int).reshape(-1, 3).T
        painted = ((red - green > 100) & (red - blue > 100) & (green < 90)).sum()
        assert (painted > 10) == one.collided, painted
        assert len(set(zip(red, green, blue, strict=True))) > 500


def test_of_each_policy_so_many_and_only_what_was_saved(failed, tmp_path):
    found, path = failed
    path.with_name("later.npz").write_bytes(path.with_suffix(".npz").read_bytes())
    other = found.model_copy(
        update={"header": found.header.model_copy(update={"policy": "straight"})}
    )
    results = {"run.json": found, "later.json.gz": other, "unsaved.json": other}
    drawn = pictures(results, path.parent, 2, False, pytest.fail)
    assert [name for name, _, _ in drawn] == ["run.json"] * 2 + ["later.json.gz"] * 2


def test_what_came_out_differently_has_no_picture(failed, rolled, tmp_path, monkeypatch):
    found, _ = failed
    asked = []

    class Again:
        def __init__(self, result, path, problem_set=None):
            asked.append(path)

        def replay(self, rows):
            places = [rolled.ids.index(row.id) for row in rows]
            remarks = ["FDO 3 came out differently", None, None]
            return [Replay(rolled.rows[i], rolled.episodes[i], remarks[i]) for i in places]

    monkeypatch.setattr("drpbench.report.pictures.Replayer", Again)
    told = []
    drawn = pictures({"run.json": found}, tmp_path, 9, True, told.append)
    assert asked == [tmp_path / "run.json"] and told == ["FDO 3 came out differently"]
    assert sorted(id for _, _, id in drawn) == rolled.ids[1:]


def test_trajectories_of_another_run_are_named_and_not_drawn(failed):
    found, path = failed
    moved = [r.model_copy(update={"position_error": r.position_error + 0.002}) for r in found.rows]
    whole = path.with_suffix(".npz").read_bytes()
    path.with_name("cut.npz").write_bytes(whole[:500])
    results = {"run.json": found.model_copy(update={"rows": moved}), "cut.json": found}
    told = []
    assert pictures(results, path.parent, 1, False, told.append) == {}
    assert len(told) == 2
    assert "no pictures of cut.json" in told[0] and "not a readable trajectory" in told[0]
    assert "does not belong to this result" in told[1]


def test_the_command_draws_what_was_saved_and_says_why_it_cannot(stored, tmp_path, monkeypatch):
    found, path = stored
    save(found, path)
    page, failures = path.with_name("report.html"), sum(not r.success for r in found.rows)

    def report(*options):
        return CliRunner().invoke(app, ["report", str(path.parent), "--out", str(page), *options])

    def drawn():
        return page.read_text().count("data:image/webp")

    assert report().exit_code == 0 and drawn() == failures > 0
    assert report("--thumbnails", "0").exit_code == 0 and drawn() == 0
    assert "must not be negative" in str(report("--thumbnails", "-1").exception)

    monkeypatch.setenv("MUJOCO_GL", "glfw")
    told = report()
    assert told.exit_code == 0 and drawn() == 0
    assert "a report without pictures: MUJOCO_GL=glfw" in told.output
    assert isinstance(report("--thumbnails", "1").exception, RecordingError)
