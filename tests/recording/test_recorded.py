"""A recording on disk is told from one that was cut short, damaged, or is another's."""

import numpy as np
import pytest
from mcap.writer import Writer

from drpbench.recording import RecordingError
from drpbench.recording.recorded import is_whole, read_recording


def write(path, name="drpbench", count=100):
    noise = np.random.default_rng(0)
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        writer.add_metadata(name, {"task": "FDO", "id": "17"})
        channel = writer.register_channel("/x", "json", 0)
        for i in range(count):
            writer.add_message(channel, i * 10**9, noise.bytes(200), i * 10**9)
        writer.finish()
    return path


@pytest.fixture
def file(tmp_path):
    return write(tmp_path / "a.mcap")


def refused(path):
    with pytest.raises(RecordingError) as error:
        read_recording(path)
    told = str(error.value)
    assert "\n" not in told and told.startswith(f"{path}: ")
    return told


def test_a_whole_one_says_what_it_is(file):
    found = read_recording(file)
    assert is_whole(file) and found.about == {"task": "FDO", "id": "17"}
    assert found.messages == 100 and found.seconds == pytest.approx(99.0)


@pytest.mark.parametrize("share", [0.0, 0.1, 0.5, 0.99])
def test_one_that_was_cut_short_is_refused(file, share):
    content = file.read_bytes()
    file.write_bytes(content[: int(share * len(content))])
    assert not is_whole(file)
    assert "cut short" in refused(file) and "makes it anew" in refused(file)


@pytest.mark.parametrize("share", [0.1, 0.2, 0.33])
def test_one_with_a_changed_byte_is_refused(file, share):
    content = bytearray(file.read_bytes())
    content[int(share * len(content))] ^= 255
    file.write_bytes(content)
    assert "damaged" in refused(file)


def test_another_file_and_no_file_are_refused(tmp_path):
    other = tmp_path / "b.mcap"
    other.write_text("{}")
    assert "no MCAP file" in refused(other)
    assert "no such file" in refused(tmp_path / "c.mcap")
    assert "no recording of drpbench" in refused(write(tmp_path / "d.mcap", name="other"))
