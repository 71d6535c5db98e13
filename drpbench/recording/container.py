"""The MCAP container (https://mcap.dev/spec): chunks of messages that are there as arrays.

The package `mcap` writes message by message, some 25 microseconds each; here its records frame
whole chunks, and NumPy makes the messages' headers and indexes.
"""

import struct
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any, BinaryIO

import numpy as np
import zstandard
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Channel,
    Chunk,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)
from mcap_protobuf.schema import build_file_descriptor_set

from drpbench import __version__

MAGIC = b"\x89MCAP0\r\n"  # how a file begins and ends
_HEADER = np.dtype(  # of a message
    {
        "names": ["opcode", "length", "channel", "sequence", "log_time", "publish_time"],
        "formats": ["u1", "<u8", "<u2", "<u4", "<u8", "<u8"],
        "offsets": [0, 1, 9, 11, 15, 23],
        "itemsize": 31,
    }
)
_LEVEL = 1  # of zstd: as small as level 3 for these numbers, in two thirds of the time


@dataclass(frozen=True)
class Messages:
    """N messages of one topic, all of one length, in the order of time."""

    topic: str
    schema: Any  # the class of protobuf messages
    times: np.ndarray  # (N,) int64 [ns]
    content: np.ndarray  # (N, length) uint8, serialised


def write(
    file: BinaryIO, groups: Sequence[Messages], metadata: Mapping[str, Mapping[str, str]], span: int
) -> None:
    """Writes a whole MCAP file: messages in the order of time, at the same time in that of
    `groups`.

    `span` is how much time [ns] a chunk covers.
    """
    groups = [group for group in groups if len(group.times)]
    out = _File(file)
    out.add(Header(profile="", library=f"drpbench {__version__}"))
    abouts = []
    for name, about in metadata.items():
        record = Metadata(name=name, metadata=dict(about))
        abouts.append(MetadataIndex(out.position, out.add(record), name))

    first = {group.topic: group for group in reversed(groups)}
    named = {schema: n + 1 for n, schema in enumerate({g.schema: None for g in first.values()})}
    schemas = [
        Schema(
            id=id, data=_described(schema), encoding="protobuf", name=schema.DESCRIPTOR.full_name
        )
        for schema, id in named.items()
    ]
    channels = [
        Channel(n + 1, topic, "protobuf", {}, named[group.schema])
        for n, (topic, group) in enumerate(first.items())
    ]
    ids = {channel.topic: channel.id for channel in channels}
    records = _Records(groups, [ids[group.topic] for group in groups])
    head = _joined([*schemas, *channels])
    chunks = []
    for part in records.parts(span):
        chunks.append(records.write_chunk(out, part, head))
        head = b""
    out.add(DataEnd(0))

    statistics = Statistics(
        attachment_count=0,
        channel_count=len(channels),
        channel_message_counts=records.counts,
        chunk_count=len(chunks),
        message_count=len(records.time),
        message_start_time=int(records.time[0]),
        message_end_time=int(records.time[-1]),
        metadata_count=len(abouts),
        schema_count=len(schemas),
    )
    _write_summary(out, [schemas, channels, [statistics], chunks, abouts])


_OPCODES = {
    Schema: Opcode.SCHEMA,
    Channel: Opcode.CHANNEL,
    Statistics: Opcode.STATISTICS,
    ChunkIndex: Opcode.CHUNK_INDEX,
    MetadataIndex: Opcode.METADATA_INDEX,
}


def _write_summary(out: "_File", sections: Sequence[Sequence[McapRecord]]) -> None:
    start, summary, offsets = out.position, b"", []
    for section in sections:
        if section:
            part = _joined(section)
            place = start + len(summary)
            offsets.append(SummaryOffset(_OPCODES[type(section[0])], place, len(part)))
            summary += part
    offset_start = start + len(summary)
    summary += _joined(offsets)
    footer = struct.pack("<BQQQ", Opcode.FOOTER, 20, start, offset_start)
    out.write(summary)
    out.add(Footer(start, offset_start, zlib.crc32(footer, zlib.crc32(summary))))
    out.write(MAGIC)


class _File:
    """What is written, and how far."""

    def __init__(self, file: BinaryIO):
        self._file, self.position = file, 0
        self.write(MAGIC)

    def write(self, data: bytes) -> int:
        self._file.write(data)
        self.position += len(data)
        return len(data)

    def add(self, record: McapRecord) -> int:
        """Writes a record; returns its length."""
        return self.write(_joined([record]))


class _Records:
    """All messages of a file as records, in the order of time."""

    def __init__(self, groups: Sequence[Messages], channels: Sequence[int]):
        pieces: list[bytes] = []
        for group, channel in zip(groups, channels, strict=True):
            pieces += _message_records(group, channel)
        lengths = [np.full(len(g.times), _HEADER.itemsize + g.content.shape[1]) for g in groups]
        ids = [np.full(len(group.times), id) for group, id in zip(groups, channels, strict=True)]
        time = np.concatenate([group.times for group in groups])
        order = np.argsort(time, kind="stable")
        self.time, self._channel = time[order], np.concatenate(ids)[order]
        self._length = np.concatenate(lengths)[order]
        self._pieces = [pieces[n] for n in order]
        found, counts = np.unique(self._channel, return_counts=True)
        self.counts = dict(zip(found.tolist(), counts.tolist(), strict=True))

    def parts(self, span: int) -> list[slice]:
        """Those of each `span` of time [ns]."""
        edges = np.searchsorted(self.time, np.arange(0, self.time[-1] + span + 1, span)).tolist()
        edges[-1] = len(self.time)
        return [slice(a, b) for a, b in zip(edges, edges[1:], strict=False) if b > a]

    def write_chunk(self, out: _File, part: slice, head: bytes) -> ChunkIndex:
        """A chunk of schemas and channels, if any, and of messages; and where it is."""
        data = b"".join([head, *self._pieces[part]])
        packed = zstandard.ZstdCompressor(_LEVEL).compress(data)
        time, channel = self.time[part], self._channel[part]
        start, end = int(time[0]), int(time[-1])
        place = out.position
        chunk = Chunk(
            compression="zstd",
            data=packed,
            message_end_time=end,
            message_start_time=start,
            uncompressed_crc=zlib.crc32(data),
            uncompressed_size=len(data),
        )
        length = out.add(chunk)
        offsets = len(head) + np.cumsum(self._length[part]) - self._length[part]
        indexes, after = {}, out.position
        for id in np.unique(channel).tolist():
            own = channel == id
            indexes[id] = out.position
            entries = np.stack([time[own], offsets[own]], axis=1).astype("<u8").tobytes()
            prefix = struct.pack("<BQHI", Opcode.MESSAGE_INDEX, 6 + len(entries), id, len(entries))
            out.write(prefix + entries)
        return ChunkIndex(
            chunk_length=length,
            chunk_start_offset=place,
            compression="zstd",
            compressed_size=len(packed),
            message_end_time=end,
            message_index_length=out.position - after,
            message_index_offsets=indexes,
            message_start_time=start,
            uncompressed_size=len(data),
        )


def _message_records(group: Messages, channel: int) -> list[bytes]:
    """Each message with its header."""
    count, length = group.content.shape
    header = np.zeros(count, _HEADER)
    header["opcode"], header["channel"] = Opcode.MESSAGE, channel
    header["length"] = _HEADER.itemsize - 9 + length
    header["log_time"] = header["publish_time"] = group.times
    flat = header.view(np.uint8).reshape(count, -1)
    whole = np.concatenate([flat, group.content], axis=1)
    return whole.view(f"V{whole.shape[1]}").ravel().tolist()


def _joined(records: Sequence[McapRecord]) -> bytes:
    builder = RecordBuilder()
    for record in records:
        record.write(builder)
    return builder.end()


@cache
def _described(schema: Any) -> bytes:
    """The schema of a class of protobuf messages, with all that it depends on."""
    return build_file_descriptor_set(schema).SerializeToString()
