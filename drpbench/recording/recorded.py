"""What a recording on disk is, and whether it is whole."""

from dataclasses import dataclass
from pathlib import Path

from mcap.records import Message, Metadata
from mcap.stream_reader import StreamReader

from .container import MAGIC
from .episode import RecordingError


@dataclass(frozen=True)
class Recorded:
    """`about` is the metadata of the file: task, id, policy, versions; `seconds` of the episode."""

    about: dict[str, str]
    messages: int
    seconds: float


def is_whole(path: Path) -> bool:
    """Whether a file begins and ends as an MCAP file does: one that was cut short does not."""
    try:
        with path.open("rb") as file:
            begins = file.read(len(MAGIC)) == MAGIC
            file.seek(-len(MAGIC), 2)
            return begins and file.read() == MAGIC
    except OSError:
        return False


def read_recording(path: Path) -> Recorded:
    """Reads all of a recording, with its checksums. Raises RecordingError: one line on what is
    wrong."""
    if not path.is_file():
        raise RecordingError(f"{path}: no such file")
    again = "drpbench replay RESULT --task TASK --id ID makes it anew"
    if not is_whole(path):
        raise RecordingError(f"{path}: no MCAP file, or cut short; {again}")
    about: dict[str, dict[str, str]] = {}
    times: list[int] = []
    try:
        with path.open("rb") as file:
            for record in StreamReader(file, validate_crcs=True).records:
                if isinstance(record, Metadata):
                    about[record.name] = dict(record.metadata)
                elif isinstance(record, Message):
                    times.append(record.log_time)
    except Exception as error:  # damage shows in the decompressor, in strings, in lengths
        told = " ".join(str(error).split()) or type(error).__name__
        raise RecordingError(f"{path}: damaged: {told}; {again}") from None
    if "drpbench" not in about or not times:
        raise RecordingError(f"{path}: an MCAP file, but no recording of drpbench")
    return Recorded(about["drpbench"], len(times), 1e-9 * (max(times) - min(times)))
