"""Messages filled by NumPy are those that protobuf reads."""

import numpy as np
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud
from hypothesis import given
from hypothesis import strategies as st

from drpbench.recording import messages
from drpbench.recording.forms import ANY_TIME, Form, any_numbers, any_points

number = st.floats(width=64, allow_nan=False)
time = st.integers(0, 100 * 10**9)
FORM = Form(messages.transforms(ANY_TIME, ["arm", "a longer name"], any_numbers(14)), numbers=14)


@given(st.lists(st.tuples(time, st.lists(number, min_size=14, max_size=14)), max_size=4))
def test_filled_messages_are_those_that_protobuf_would_make(rows):
    times = np.array([time for time, _ in rows], np.int64)
    numbers = np.array([numbers for _, numbers in rows]).reshape(len(rows), 14)
    filled = FORM.fill(times, numbers)
    assert filled.shape == (len(rows), FORM.size)
    for message, (time, values) in zip(filled, rows, strict=True):
        made = messages.transforms(time, ["arm", "a longer name"], values)
        assert FrameTransforms.FromString(message.tobytes()) == made


def test_clouds_of_any_size_hold_their_points():
    rng = np.random.default_rng(0)
    times = np.array([0, 10**9 - 1, 16_666_666_666])
    for count in (0, 1, 300):
        points = rng.normal(size=(3, count, 3)).astype(np.float32)
        form = Form(messages.point_cloud(ANY_TIME, any_points(count)), points=count)
        for message, time, own in zip(form.fill(times, points=points), times, points, strict=True):
            found = PointCloud.FromString(message.tobytes())
            assert found == messages.point_cloud(int(time), own)


def test_a_number_that_stands_twice_is_filled_twice():
    mark = messages.entity("a", messages.WORLD, ANY_TIME)
    place = any_numbers(3)
    messages.add_line(mark, [place, place], 0.01, (1.0, 0.0, 0.0))
    filled = Form(mark, numbers=3).fill(np.array([5]), np.array([[1.0, 2.0, 3.0]]))
    points = type(mark).FromString(filled[0].tobytes()).lines[0].points
    assert [[p.x, p.y, p.z] for p in points] == [[1.0, 2.0, 3.0]] * 2
