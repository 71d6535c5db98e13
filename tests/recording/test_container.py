"""The file as MCAP's own reader takes it: checksums, order, index, summary."""

import io

import numpy as np
import pytest
from google.protobuf.wrappers_pb2 import DoubleValue, StringValue
from mcap.reader import NonSeekingReader, make_reader
from mcap_protobuf.decoder import DecoderFactory

from drpbench.recording.container import Messages, write

SPAN = 1000  # [ns]


def _messages(topic, times, message_of):
    content = [np.frombuffer(message_of(t).SerializeToString(), np.uint8) for t in times]
    return Messages(topic, type(message_of(0)), np.array(times), np.stack(content))


def _number(time):
    return DoubleValue(value=time + 0.5)


@pytest.fixture(scope="module")
def written():
    """Three topics, one in two groups, over two chunks with a gap between them; and the file."""
    groups = [
        _messages("/name", [7, 3000], lambda t: StringValue(value=f"at {t:06d}")),
        _messages("/slow", [0, 500, 3500], _number),
        _messages("/fast", [0, 1, 7, 999, 3000], _number),
        _messages("/slow", [250], _number),
        Messages("/never", DoubleValue, np.zeros(0, int), np.zeros((0, 9), np.uint8)),
    ]
    file = io.BytesIO()
    write(file, groups, {"about": {"task": "FDO"}}, SPAN)
    return groups, file.getvalue()


EXPECTED = [
    *[(0, "/slow"), (0, "/fast"), (1, "/fast"), (7, "/name"), (7, "/fast"), (250, "/slow")],
    *[(500, "/slow"), (999, "/fast"), (3000, "/name"), (3000, "/fast"), (3500, "/slow")],
]


@pytest.mark.parametrize("seeking", [True, False])
def test_messages_come_in_the_order_of_time_and_then_of_groups(written, seeking):
    factories = [DecoderFactory()]
    file = io.BytesIO(written[1])
    if seeking:
        reader = make_reader(file, validate_crcs=True, decoder_factories=factories)
    else:
        reader = NonSeekingReader(file, validate_crcs=True, decoder_factories=factories)
    found = list(reader.iter_decoded_messages(log_time_order=False))
    assert [(message.log_time, channel.topic) for _, channel, message, _ in found] == EXPECTED
    for _, channel, message, content in found:
        assert message.publish_time == message.log_time
        number = channel.topic != "/name"
        assert content.value == (message.log_time + 0.5 if number else f"at {message.log_time:06d}")


def test_the_index_finds_a_span_of_one_topic(written):
    reader = make_reader(io.BytesIO(written[1]), validate_crcs=True)
    found = reader.iter_messages(topics=["/slow"], starting_at=250, ending_at=3500)
    assert [message.log_time for _, _, message in found] == [250, 500, 3500]


def test_the_summary_counts_what_is_there(written):
    reader = make_reader(io.BytesIO(written[1]), validate_crcs=True)
    summary = reader.get_summary()
    topics = {id: channel.topic for id, channel in summary.channels.items()}
    counts = summary.statistics.channel_message_counts
    named = {topics[id]: count for id, count in counts.items()}
    assert named == {"/name": 2, "/slow": 4, "/fast": 5}
    assert summary.statistics.message_count == 11
    assert (summary.statistics.message_start_time, summary.statistics.message_end_time) == (0, 3500)
    assert [(c.message_start_time, c.message_end_time) for c in summary.chunk_indexes] == [
        (0, 999),
        (3000, 3500),
    ]
    assert [dict(record.metadata) for record in reader.iter_metadata()] == [{"task": "FDO"}]


def test_one_message_at_the_start_is_a_file():
    file = io.BytesIO()
    write(file, [_messages("/slow", [0], _number)], {}, SPAN)
    ((_, _, message),) = make_reader(io.BytesIO(file.getvalue())).iter_messages()
    assert message.log_time == 0
