"""A run that is killed leaves whole files only, and the run that goes on with it makes the
others."""

import os
import signal
import subprocess
import time

import pytest
from mcap.reader import make_reader

from drpbench.recording.recorder import Recorder
from drpbench.results import load, save

from ..few_lanes import DRPBENCH

pytestmark = pytest.mark.slow

IDS = range(6)


def joint_states(path):
    """How many there are in a file, checksums looked at."""
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        return sum(1 for _ in reader.iter_messages(topics=["/joint_states"]))


@pytest.fixture
def drpbench(tmp_path):
    """A recorded run of `hold` in a process of its own: the process."""
    environment = {**os.environ, "JAX_PLATFORMS": "cpu"}
    processes = []

    def start(*more):
        arguments = ["run", "--task", "FDO", "--policy", "hold", "--problems", "0-5"]
        arguments += ["--batch-size", "2", "--record", "--out", tmp_path / "x.json.gz", *more]
        command = [*DRPBENCH, *map(str, arguments)]
        process = subprocess.Popen(command, env=environment, stdout=subprocess.DEVNULL)
        processes.append(process)
        return process

    yield start
    for process in processes:
        process.kill()
        process.wait()


def test_a_killed_run_leaves_whole_files_and_the_resumed_one_makes_the_others(drpbench, tmp_path):
    process, folder = drpbench(), tmp_path / "x"
    until = time.monotonic() + 240
    while not list(folder.glob("*.mcap")):
        assert process.poll() is None and time.monotonic() < until
        time.sleep(0.001)
    process.send_signal(signal.SIGKILL)
    process.wait()
    there = sorted(folder.glob("*.mcap"))
    assert 0 < len(there) < len(IDS) and not (tmp_path / "x.json.gz").exists()
    assert all(joint_states(path) == 1001 for path in there)

    assert drpbench("--resume").wait(timeout=240) == 0
    names = [f"FDO-{id:05d}.mcap" for id in IDS]
    assert sorted(path.name for path in folder.iterdir()) == names
    assert all(joint_states(folder / name) == 1001 for name in names)
    assert [row.id for row in load(tmp_path / "x.json.gz").rows] == list(IDS)


def test_what_a_broken_run_left_out_is_replayed_at_the_end(stored, rolled, header):
    """Of three episodes one is there, one is of an older run, and one is half written."""
    result, path = stored
    save(result, path)
    folder = path.with_suffix("")
    Recorder(folder).write(header, rolled.episodes[0])
    kept, old, half = (
        folder / name for name in ("FDO-00003.mcap", "FDO-00017.mcap", ".a.mcap.tmp")
    )
    before = kept.stat().st_mtime_ns
    old.write_bytes(b"of an older run")
    os.utime(old, (1e9, 1e9))
    half.touch()
    wrote = []
    with Recorder(folder, {"FDO": {3, 17}}, path, wrote=lambda: wrote.append(1)):
        pass
    assert sorted(folder.iterdir()) == [kept, old]
    assert kept.stat().st_mtime_ns == before and joint_states(old) == 1001
    assert len(wrote) == 2  # the one that was there, and the one that was made anew


def test_a_run_that_fails_is_not_completed(tmp_path):
    with pytest.raises(RuntimeError), Recorder(tmp_path, None, tmp_path / "never.json"):
        raise RuntimeError
