import gzip
import json
import time
import tracemalloc
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

import drpbench.results.schema as results_module
from drpbench.results import Result, ResultsError, load, save
from drpbench.results.schema import schema_json

finite = st.floats(allow_nan=False, allow_infinity=False)
positive = st.floats(min_value=0, allow_nan=False, allow_infinity=False)


@pytest.fixture
def damaged(tmp_path, make_result):
    """Saves a good result after a change to its JSON data; gives the path."""

    def write(change):
        path = tmp_path / "run.json"
        save(make_result(), path)
        data = json.loads(path.read_text())
        change(data)
        path.write_text(json.dumps(data))
        return path

    return write


def refusal(path):
    with pytest.raises(ResultsError) as caught:
        load(path)
    message = str(caught.value)
    assert message.startswith(f"{path}: ")
    assert "\n" not in message
    return message.removeprefix(f"{path}: ")


@settings(deadline=None)
@given(
    clearance=st.none() | finite,
    error=positive,
    sparc=st.none() | finite,
    family=st.text(min_size=1),
)
def test_what_is_saved_is_loaded(
    tmp_path_factory, make_header, make_row, clearance, error, sparc, family
):
    row = make_row(min_clearance=clearance, position_error=error, sparc_ee=sparc, family=family)
    result = Result(header=make_header(), rows=[row])
    path = tmp_path_factory.mktemp("round") / "run.json"
    save(result, path)
    assert load(path) == result


def test_a_saved_file_has_one_row_a_line(tmp_path, make_result):
    path = tmp_path / "run.json"
    save(make_result(), path)
    lines = path.read_text().splitlines()
    assert sum(line.startswith('{"id":') for line in lines) == 3


def test_a_compressed_file_holds_the_text_of_the_plain_one(tmp_path, make_result):
    plain, packed = tmp_path / "run.json", tmp_path / "run.json.gz"
    result = make_result(verdicts={"FDO": "+-x" * 100})
    save(result, plain)
    save(result, packed)
    assert gzip.decompress(packed.read_bytes()) == plain.read_bytes()
    assert packed.stat().st_size < plain.stat().st_size / 5
    assert load(packed) == load(plain) == result


def test_a_compressed_file_depends_on_its_content_alone(tmp_path, make_result, monkeypatch):
    written = []
    for name, now in (("a.json.gz", 1.0e9), ("b.json.gz", 1.5e9)):
        monkeypatch.setattr(time, "time", lambda now=now: now)
        save(make_result(), tmp_path / name)
        written.append((tmp_path / name).read_bytes())
    assert written[0] == written[1]


def test_a_file_that_gzip_made_is_read(tmp_path, make_result):
    plain, packed = tmp_path / "run.json", tmp_path / "run.json.gz"
    save(make_result(), plain)
    with gzip.GzipFile(plain, "wb", fileobj=packed.open("wb")) as file:  # with a name and a time
        file.write(plain.read_bytes())
    assert load(packed) == make_result()


def test_a_compressed_file_cut_short_anywhere_is_refused(tmp_path, make_result):
    path = tmp_path / "run.json.gz"
    save(make_result(), path)
    whole = path.read_bytes()
    for length in range(len(whole)):
        path.write_bytes(whole[:length])
        message = refusal(path)
        assert message.startswith("is not gzip, or damaged (") or length == 0


def test_a_compressed_file_with_a_wrong_bit_is_refused_or_means_the_same(tmp_path, make_result):
    path = tmp_path / "run.json.gz"
    save(make_result(), path)
    whole, refused = path.read_bytes(), 0
    for place in range(len(whole)):
        path.write_bytes(whole[:place] + bytes([whole[place] ^ 1]) + whole[place + 1 :])
        try:
            assert load(path) == make_result()  # a bit of gzip's header that says nothing of it
        except ResultsError:
            assert refusal(path)
            refused += 1
    assert refused >= len(whole) - 10  # bytes that say when and where it was packed


def test_a_name_that_lies_about_compression_is_refused(tmp_path, make_result):
    plain, packed = tmp_path / "run.json", tmp_path / "run.json.gz"
    save(make_result(), plain)
    text = plain.read_bytes()
    packed.write_bytes(text)
    plain.write_bytes(gzip.compress(text))
    assert refusal(packed).startswith("is not gzip, or damaged (")
    assert refusal(plain).startswith("is not JSON, or cut short (")


@pytest.mark.parametrize("name", ["run.json", "run.json.gz"])
def test_a_huge_file_is_refused_before_it_is_held_whole(tmp_path, monkeypatch, name):
    monkeypatch.setattr(results_module, "LARGEST", 1_000_000)
    text, path = b" " * 50_000_000, tmp_path / name
    path.write_bytes(gzip.compress(text, 1) if path.suffix == ".gz" else text)
    tracemalloc.start()
    assert refusal(path) == "holds more than 1 MB, which no result file does"
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 5_000_000


def test_a_missing_file_is_named(tmp_path):
    for name in ("none.json", "none.json.gz"):
        assert refusal(tmp_path / name) == "cannot be read: no such file or directory"


def test_a_folder_is_no_result(tmp_path):
    assert refusal(tmp_path) == "cannot be read: is a directory"


@pytest.mark.parametrize("text", [b"", b"hello", b"\xff\xfe", b'{"header": '])
def test_what_is_not_json_is_refused(tmp_path, text):
    path = tmp_path / "run.json"
    path.write_bytes(text)
    assert refusal(path).startswith("is not JSON, or cut short (")


def test_a_file_cut_short_anywhere_is_refused(tmp_path, make_result):
    path = tmp_path / "run.json"
    save(make_result(), path)
    text = path.read_bytes().rstrip()
    for length in range(0, len(text), 7):
        path.write_bytes(text[:length])
        assert "cut short" in refusal(path)


def test_another_schema_version_is_named_before_anything_else(damaged):
    def change(data):
        data["header"]["schema_version"] = 2
        data["header"].pop("policy")
        data["rows"][0]["new_field"] = 1

    assert refusal(damaged(change)) == "header.schema_version is 2; this drpbench reads 1"


def test_a_missing_field_is_named_with_its_row(damaged):
    assert refusal(damaged(lambda d: d["rows"][2].pop("collided"))) == "rows[2].collided is missing"
    assert refusal(damaged(lambda d: d["header"].pop("seed"))) == "header.seed is missing"


def test_an_unknown_field_is_named(damaged):
    message = refusal(damaged(lambda d: d["rows"][1].update(score=3)))
    assert message == "rows[1].score is not a field of the format"


def test_json_of_another_kind_is_refused(tmp_path):
    path = tmp_path / "run.json"
    path.write_text("[1, 2]")
    assert refusal(path) == "input should be an object, got [1, 2]"


@pytest.mark.parametrize(
    ("field", "value", "words"),
    [
        ("reached", 1, "input should be a valid boolean, got 1"),
        ("id", "7", "input should be a valid integer, got '7'"),
        ("id", -1, "input should be greater than or equal to 0, got -1"),
        ("position_error", float("nan"), "input should be a finite number, got nan"),
        ("min_clearance", float("inf"), "input should be a finite number, got inf"),
        ("sparc_ee", "-2", "input should be a valid number, got '-2'"),
        ("ee_path_length", -0.5, "input should be greater than or equal to 0, got -0.5"),
    ],
)
def test_a_wrong_value_is_named_with_its_row(damaged, field, value, words):
    message = refusal(damaged(lambda d: d["rows"][1].__setitem__(field, value)))
    assert message == f"rows[1].{field}: {words}"


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"success": False}, "success must be exactly"),
        ({"reached_5cm": False}, "reached implies reached_5cm"),
        ({"reached_once": False}, "reached implies"),
        ({"time_to_goal": None}, "time_to_goal must be a number exactly where reached"),
        ({"first_collision_step": 3}, "first_collision_step must be a number exactly where"),
        ({"first_collision_link": "hand"}, "first_collision_link must be named exactly"),
        ({"status": "nan"}, "reached must be false where status is nan"),
        ({"position_error": None}, "position_error may be null only where status is not ok"),
    ],
)
def test_a_row_at_odds_with_itself_is_refused(damaged, changes, words):
    message = refusal(damaged(lambda d: d["rows"][0].update(changes)))
    assert message.startswith("rows[0]: FDO 0: ")
    assert words in message


def test_success_despite_a_collision_is_refused(damaged):
    message = refusal(damaged(lambda d: d["rows"][2].update(success=True)))
    assert message == "rows[2]: FDO 2: success must be exactly: reached and not collided"


def test_a_failed_simulation_needs_no_measurements(make_row):
    row = make_row(
        reached=False, status="nan", position_error=None, orientation_error=None,
        joint_path_length=None, ee_path_length=None, min_clearance=None,
        sparc_joint=None, sparc_ee=None,
    )  # fmt: skip
    assert not row.success


def test_an_instance_standing_twice_is_refused(damaged):
    message = refusal(damaged(lambda d: d["rows"].append(d["rows"][1])))
    assert message == "rows[3]: FDO 1 stands twice"


def test_a_row_of_a_task_not_in_the_header_is_refused(damaged):
    message = refusal(damaged(lambda d: d["rows"][1].update(task="SE")))
    assert message == "rows[1]: task SE is not in the header's tasks"


def test_ids_asked_for_must_be_there_and_no_others(damaged):
    def ask(ids):
        return refusal(damaged(lambda d: d["header"].update(problems={"FDO": ids})))

    assert ask([0, 1, 2, 5, 9]) == (
        "rows: 2 of the 5 FDO problems asked for are missing (first: 5)"
    )
    assert ask([0, 2]) == "rows: FDO 1 was not asked for in the header"


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"tasks": ["FDO", "FDO"]}, "names a task twice"),
        ({"problems": {"SE": None}}, "name different tasks"),
        ({"problems": {"FDO": [1, 1]}}, "holds an id twice"),
        ({"versions": {"jax": "1"}}, "versions lacks drpbench, python, jaxlib"),
        ({"problem_set_sha256": "xyz"}, "problem_set_sha256"),
        ({"created": "yesterday"}, "created"),
        ({"created": "2025-01-01T00:00:00+02:00"}, "created"),
        ({"policy_parameters": {"gain": float("nan")}}, "policy_parameters"),
        ({"policy_parameters": {"gain": None}}, "policy_parameters"),
        ({"tasks": []}, "tasks"),
    ],
)
def test_a_header_out_of_order_is_refused(make_header, changes, words):
    with pytest.raises(ValidationError, match=words):
        make_header(**changes)


def test_parameters_keep_their_types(tmp_path, make_result):
    parameters = {"a": 1, "b": 1.0, "c": True, "d": "x", "e": [1, 2.5, "y", False]}
    path = tmp_path / "run.json"
    save(make_result(policy_parameters=parameters), path)
    loaded = load(path).header.policy_parameters
    assert loaded == parameters
    assert [type(value) for value in loaded.values()] == [int, float, bool, str, list]


def test_a_failed_save_leaves_the_old_file_and_no_litter(tmp_path, make_result, monkeypatch):
    path = tmp_path / "run.json"
    save(make_result(), path)
    before = path.read_bytes()

    def refuse(descriptor):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(results_module.os, "fsync", refuse)
    with pytest.raises(ResultsError, match="cannot be written: no space left on device"):
        save(make_result("straight"), path)
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]


def test_saving_beneath_a_file_is_refused_in_one_line(tmp_path, make_result):
    (tmp_path / "file").touch()
    with pytest.raises(ResultsError, match="cannot be written"):
        save(make_result(), tmp_path / "file" / "run.json")


@pytest.mark.slow
def test_fifty_thousand_rows_load_in_seconds(tmp_path, make_result):
    path = tmp_path / "run.json"
    save(make_result(verdicts={"SE": "+-x+-" * 10_000}), path)
    began = time.perf_counter()
    assert len(load(path).rows) == 50_000
    assert time.perf_counter() - began < 5


def test_a_file_of_fifty_thousand_bad_rows_is_refused_as_fast(tmp_path, make_result):
    path = tmp_path / "run.json"
    save(make_result(verdicts={"SE": "+" * 50_000}), path)
    path.write_text(path.read_text().replace('"task":', '"game":'))
    began = time.perf_counter()
    assert refusal(path) == "rows[0].task is missing"
    assert time.perf_counter() - began < 5


def test_the_published_schema_is_the_models():
    published = Path(results_module.__file__).with_name("result.schema.json").read_text()
    assert published == schema_json(), (
        "write it anew with: python -c 'from drpbench.results.schema import schema_json;"
        ' print(schema_json(), end="")\' > drpbench/results/result.schema.json'
    )
