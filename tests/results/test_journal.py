import os
import signal
import subprocess
import sys
import time

import pytest

from drpbench.results import Journal, ResultsError, load
from drpbench.results.schema import VERSIONED


@pytest.fixture
def path(tmp_path):
    return tmp_path / "run.json"


@pytest.fixture
def partial(path):
    return path.with_name("run.json.partial")


def refusal(action, *arguments):
    with pytest.raises(ResultsError) as caught:
        action(*arguments)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_a_run_becomes_its_result_file(path, partial, make_header, make_row):
    header = make_header(tasks=("SE", "FDO"))
    with Journal.create(path, header) as journal:
        journal.append([make_row("FDO", 2), make_row("SE", 1)], seconds=1.5)
        journal.append([make_row("FDO", 0), make_row("SE", 0)], seconds=2.0)
        assert partial.exists() and not path.exists()
        result = journal.finish()
    assert [row.key for row in result.rows] == [("SE", 0), ("SE", 1), ("FDO", 0), ("FDO", 2)]
    assert result.header == header.model_copy(update={"wall_seconds": 3.5})
    assert load(path) == result
    assert not partial.exists()


def test_rows_are_on_disk_when_append_returns(path, partial, make_header, make_row):
    with Journal.create(path, make_header()) as journal:
        journal.append([make_row(id=7)])
        assert make_row(id=7).model_dump_json() in partial.read_text().splitlines()


def test_nothing_is_overwritten(path, partial, make_header, make_result):
    header = make_header()
    Journal.create(path, header).close()
    before = partial.read_bytes()
    message = refusal(Journal.create, path, header)
    assert "--resume" in message and "--out" in message
    assert partial.read_bytes() == before
    partial.unlink()
    path.write_text("precious")
    assert "--out" in refusal(Journal.create, path, header)
    assert path.read_text() == "precious"
    assert not partial.exists()


def test_a_compressed_run_goes_on_where_it_stopped(tmp_path, make_header, make_row):
    path = tmp_path / "run.json.gz"
    with Journal.create(path, make_header()) as journal:
        journal.append([make_row(id=1)])
    log = tmp_path / "run.json.gz.partial"
    assert make_row(id=1).model_dump_json() in log.read_text().splitlines()
    with Journal.resume(path, make_header()) as journal:
        journal.append([make_row(id=0)])
        result = journal.finish()
    assert [path] == list(tmp_path.iterdir())
    assert path.read_bytes()[:2] == b"\x1f\x8b" and load(path) == result
    assert Journal.resume(path, make_header()).finished


@pytest.mark.parametrize("begin", [Journal.create, Journal.resume])
@pytest.mark.parametrize(("name", "other"), [("x.json", "x.json.gz"), ("x.json.gz", "x.json")])
def test_plain_and_compressed_do_not_stand_side_by_side(
    tmp_path, make_header, make_row, begin, name, other
):
    path, there = tmp_path / name, tmp_path / other
    with Journal.create(there, make_header()) as journal:
        message = refusal(begin, path, make_header())
        assert message.startswith(f"{there}.partial: ") and f"--resume --out {there}" in message
        journal.append([make_row()])
        journal.finish()
    message = refusal(begin, path, make_header())
    assert message.startswith(f"{there}: exists; ") and "--out" in message
    assert list(tmp_path.iterdir()) == [there]


@pytest.mark.parametrize("name", ["run.json", "run.json.gz"])
def test_a_result_that_appears_during_the_run_stays(path, partial, make_header, make_row, name):
    with Journal.create(path, make_header()) as journal:
        journal.append([make_row()])
        path.with_name(name).write_text("precious")
        message = refusal(journal.finish)
    assert message.startswith(f"{path.with_name(name)}: appeared during the run")
    assert path.with_name(name).read_text() == "precious" and partial.exists()


def test_resuming_goes_on_where_it_stopped(path, make_header, make_row):
    with Journal.create(path, make_header(batch_size=64)) as journal:
        journal.append([make_row(id=1), make_row(id=4)], seconds=2.0)
    later = make_header(batch_size=8, created="2025-02-02T00:00:00Z", platform="elsewhere")
    with Journal.resume(path, later) as journal:
        assert journal.done == {("FDO", 1), ("FDO", 4)}
        journal.append([make_row(id=0)], seconds=0.5)
        result = journal.finish()
    assert [row.id for row in result.rows] == [0, 1, 4]
    assert result.header.wall_seconds == 2.5
    assert result.header.created == make_header().created


def test_resuming_where_there_is_nothing_begins(path, make_header, make_row):
    with Journal.resume(path, make_header()) as journal:
        assert journal.done == set()
        journal.append([make_row()])
        assert len(journal.finish().rows) == 1


def test_a_finished_run_comes_back_finished(path, make_header, make_row):
    with Journal.create(path, make_header()) as journal:
        journal.append([make_row()], seconds=3.0)
        result = journal.finish()
    before = path.stat()
    again = Journal.resume(path, make_header())
    assert again.finished
    assert again.done == {("FDO", 0)}
    assert again.finish() == result
    assert path.stat().st_mtime_ns == before.st_mtime_ns
    assert "finished" in refusal(again.append, [make_row(id=1)])


def test_killed_between_result_and_clean_up_is_finished(path, partial, make_header, make_row):
    with Journal.create(path, make_header()) as journal:
        journal.append([make_row()])
        left = partial.read_bytes()
        journal.finish()
    partial.write_bytes(left)
    assert Journal.resume(path, make_header()).finished
    assert not partial.exists()


@pytest.mark.slow
def test_a_log_cut_at_any_byte_keeps_every_whole_row(path, partial, make_header, make_row):
    header = make_header()
    with Journal.create(path, header) as journal:
        journal.append([make_row(id=0), make_row(id=1)], seconds=1.0)
        journal.append([make_row(id=2)], seconds=1.0)
    text = partial.read_bytes()
    for length in range(len(text) + 1):
        partial.write_bytes(text[:length])
        with Journal.resume(path, header) as journal:
            whole = text[:length].count(b'\n{"id"') - (b'{"id"' in text[:length].split(b"\n")[-1])
            assert journal.done == {("FDO", instance) for instance in range(whole)}
            journal.append([make_row(id=i) for i in range(whole, 4)])
        with Journal.resume(path, header) as journal:
            assert len(journal.done) == 4


@pytest.mark.parametrize(
    ("damage", "words"),
    [
        (lambda lines: lines[:2] + [lines[2][:50]] + lines[3:], "line 3: is not JSON"),
        (lambda lines: [*lines, b"\x00" * 20], "line 5: is not JSON"),
        (lambda lines: [*lines, b""], "line 5: is not JSON"),
        (lambda lines: [*lines, lines[3]], "line 5: FDO 1 stands there already"),
        (lambda lines: lines[1:], "line 1: "),
        (lambda lines: [lines[0], *lines], "line 2: "),
        (lambda lines: lines[:3] + [lines[3].replace(b"FDO", b"SE")], "line 4: SE 1 was not asked"),
        (lambda lines: lines[:3] + [lines[3].replace(b'"reached":true', b'"reached":1')],
         "line 4: reached: input should be a valid boolean"),
        (lambda lines: [lines[0].replace(b'version":1', b'version":9'), *lines[1:]],
         "line 1: schema_version is 9; this drpbench reads 1"),
    ],
)  # fmt: skip
def test_other_damage_names_its_line(path, partial, make_header, make_row, damage, words):
    with Journal.create(path, make_header()) as journal:
        journal.append([make_row(id=0), make_row(id=1)])
    text = b"\n".join(damage(partial.read_bytes().split(b"\n")[:-1])) + b"\n"
    partial.write_bytes(text)
    message = refusal(Journal.resume, path, make_header())
    assert message.startswith(f"{partial}: ")
    assert words in message
    assert partial.read_bytes() == text


def test_a_strange_file_is_not_taken_for_a_log(path, partial, make_header):
    partial.write_text("notes without a line end")
    assert "line 1: is not the log of a run" in refusal(Journal.resume, path, make_header())
    assert partial.read_text() == "notes without a line end"


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"policy": "straight"}, "policy was rmp, is straight"),
        ({"policy_parameters": {"gain": 9.0, "levels": [1, 2]}},
         "policy_parameters.gain was 100.0, is 9.0"),
        ({"policy_parameters": {"gain": 100.0}}, "policy_parameters.levels was [1, 2], is absent"),
        ({"problem_set": "drpbench-v2"}, "problem_set was drpbench-v1, is drpbench-v2"),
        ({"problem_set_sha256": "b" * 64}, "problem_set_sha256 was aaaa"),
        ({"seed": 3}, "seed was 0, is 3"),
        ({"precision": "float64"}, "precision was float32, is float64"),
        ({"device": "gpu"}, "device was cpu, is gpu"),
        ({"privileged": True}, "privileged was False, is True"),
        ({"versions": dict.fromkeys(VERSIONED, "1.0") | {"jax": "2.0"}},
         "versions.jax was 1.0, is 2.0"),
        ({"problems": {"FDO": [1, 2]}}, "problems.FDO was all, is [1, 2]"),
        ({"tasks": ["SE"], "problems": {"SE": None}}, "tasks was ['FDO'], is ['SE']"),
    ],
)  # fmt: skip
@pytest.mark.parametrize("finished", [False, True])
def test_other_settings_are_refused_by_name(
    path, partial, make_header, make_row, changes, words, finished
):
    with Journal.create(path, make_header()) as journal:
        journal.append([make_row()])
        if finished:
            journal.finish()
    message = refusal(Journal.resume, path, make_header(**changes))
    assert words in message
    assert partial.exists() != finished


def test_a_row_is_never_held_twice(path, make_header, make_row):
    with Journal.create(path, make_header(problems={"FDO": [0, 1]})) as journal:
        journal.append([make_row(id=0)])
        assert "FDO 0 stands there already" in refusal(journal.append, [make_row(id=0)])
        block = [make_row(id=1), make_row(id=1)]
        assert "FDO 1 stands there already" in refusal(journal.append, block)
        assert "FDO 2 was not asked for" in refusal(journal.append, [make_row(id=2)])
        assert journal.done == {("FDO", 0)}
    with Journal.resume(path, make_header(problems={"FDO": [0, 1]})) as journal:
        assert journal.done == {("FDO", 0)}


def test_a_run_with_rows_missing_does_not_finish(path, partial, make_header, make_row):
    with Journal.create(path, make_header(problems={"FDO": [0, 1]})) as journal:
        journal.append([make_row()])
        assert "1 of the 2 FDO problems asked for are missing" in refusal(journal.finish)
        assert not path.exists()
        journal.append([make_row(id=1)])
        journal.finish()
    assert path.exists() and not partial.exists()


def test_a_file_that_appeared_meanwhile_is_not_overwritten(path, partial, make_header, make_row):
    with Journal.create(path, make_header()) as journal:
        journal.append([make_row()])
        path.write_text("someone else's")
        assert "not overwritten" in refusal(journal.finish)
    assert path.read_text() == "someone else's"
    assert partial.exists()


def test_a_run_in_progress_cannot_be_resumed_by_another(path, make_header):
    pytest.importorskip("fcntl", reason="file locks are POSIX")
    with Journal.create(path, make_header()):
        assert "another run is writing" in refusal(Journal.resume, path, make_header())
    Journal.resume(path, make_header()).close()


def test_a_full_disk_is_told_in_one_line_and_loses_nothing(
    path, make_header, make_row, monkeypatch
):
    journal = Journal.create(path, make_header())
    journal.append([make_row(id=0)])
    with monkeypatch.context() as patch:

        def refuse(descriptor):
            raise OSError(28, "No space left on device")

        patch.setattr(os, "fsync", refuse)
        message = refusal(journal.append, [make_row(id=1)])
        assert "cannot be written: no space left on device" in message
    assert "closed" in refusal(journal.append, [make_row(id=2)])
    with Journal.resume(path, make_header()) as journal:
        assert ("FDO", 0) in journal.done


def test_a_place_that_cannot_be_written_is_named(tmp_path, make_header):
    (tmp_path / "file").touch()
    path = tmp_path / "file" / "run.json"
    assert "cannot be written" in refusal(Journal.create, path, make_header())


# A run that appends blocks until all 6000 instances are done, telling each block it has safely
# appended; with a count, it is killed inside that append, between the write and the fsync.
CHILD = """
import os, signal, sys
from drpbench.results.journal import Journal
from drpbench.results.schema import Header, Row

folder, die_at = sys.argv[1], int(sys.argv[2])
header = Header.model_validate_json(open(f"{folder}/header.json").read())
row = Row.model_validate_json(open(f"{folder}/row.json").read())
journal = Journal.resume(f"{folder}/run.json", header)
synced = os.fsync
calls = 0

def fsync(descriptor):
    global calls
    calls += 1
    if calls == die_at:
        os.kill(os.getpid(), signal.SIGKILL)
    synced(descriptor)

os.fsync = fsync
todo = [i for i in range(6000) if ("FDO", i) not in journal.done]
for start in range(0, len(todo), 500):
    block = todo[start : start + 500]
    journal.append([row.model_copy(update={"id": i}) for i in block], seconds=1.0)
    print(*block, flush=True)
journal.finish()
"""


@pytest.fixture
def child(tmp_path, make_header, make_row):
    (tmp_path / "header.json").write_text(make_header().model_dump_json())
    (tmp_path / "row.json").write_text(make_row().model_dump_json())

    def start(die_at=0):
        return subprocess.Popen(
            [sys.executable, "-c", CHILD, str(tmp_path), str(die_at)],
            stdout=subprocess.PIPE,
            text=True,
            env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)},
        )

    return start


@pytest.mark.slow
def test_a_run_killed_over_and_over_loses_and_repeats_nothing(path, make_header, make_row, child):
    safe = set()
    for blocks_before_kill in (0, 1, 3):
        process = child()
        for _ in range(blocks_before_kill):
            safe.update(map(int, process.stdout.readline().split()))
        if blocks_before_kill:
            time.sleep(0.002)  # into the next append
        process.send_signal(signal.SIGKILL)
        told, _ = process.communicate()
        safe.update(int(instance) for line in told.splitlines() for instance in line.split())
        with Journal.resume(path, make_header()) as journal:
            assert safe <= {instance for _, instance in journal.done}
    process = child()
    told, _ = process.communicate()
    assert process.returncode == 0
    assert safe.isdisjoint(map(int, told.split()))  # nothing repeated
    assert [row.id for row in load(path).rows] == list(range(6000))  # nothing lost


@pytest.mark.slow
def test_a_kill_inside_an_append_resumes(path, partial, make_header, child):
    process = child(die_at=3)
    told, _ = process.communicate()
    assert process.returncode == -signal.SIGKILL
    safe = set(map(int, told.split()))
    assert len(safe) == 1000 and not path.exists()
    # The kill may equally have torn the block it was writing.
    partial.write_bytes(partial.read_bytes()[:-100])
    process = child()
    told, _ = process.communicate()
    assert process.returncode == 0
    assert safe.isdisjoint(map(int, told.split()))
    assert [row.id for row in load(path).rows] == list(range(6000))
    assert not partial.exists()


def test_a_run_that_failed_before_its_first_row_blocks_no_other(tmp_path, make_header):
    path = tmp_path / "run.json"
    with pytest.raises(RuntimeError), Journal.create(path, make_header()):
        raise RuntimeError
    assert list(tmp_path.iterdir()) == []
    Journal.create(path, make_header()).close()


def test_a_run_that_is_alive_is_not_to_be_resumed(tmp_path, make_header):
    path = tmp_path / "run.json"
    with (
        Journal.create(path, make_header()),
        pytest.raises(ResultsError, match="another run is writing to it"),
    ):
        Journal.create(path, make_header())
