"""Many messages of one shape at once: serialised once with blanks, and the blanks filled by NumPy.

Protobuf's own serialising takes some microseconds a message, filling it from Python as many again;
an episode has thousands. Here the real message says where its numbers stand, so no layout is
written by hand.
"""

import struct
from functools import cached_property
from typing import Any

import numpy as np

_SECONDS, _NANOS = 0x1FA5_3C96, 0x3A5C_69E1
ANY_TIME = _SECONDS * 10**9 + _NANOS
"""Stands for a message's time [ns] where it is left open."""
_POINT = struct.pack("<f", -1.2345678e30)


def any_number(place: int) -> float:
    """Stands for a message's number where it is left open; `place` counts them from 0."""
    return struct.unpack("<d", struct.pack("<Q", 0x7E5A_3C96_69A5_0000 + place))[0]


def any_numbers(count: int, first: int = 0) -> list[float]:
    """As many of them, in order."""
    return [any_number(place) for place in range(first, first + count)]


def any_points(count: int) -> np.ndarray:
    """Stands for a point cloud's points (N, 3) where they are left open."""
    return np.frombuffer(_POINT * (3 * count), "<f4").reshape(count, 3)


class Form:
    """A protobuf message with blanks: times, `numbers` doubles and a cloud of `points` points.

    Blanks are ANY_TIME, `any_number(0)` ... and `any_points`. Every time is filled with the same
    one.
    """

    def __init__(self, message: Any, numbers: int = 0, points: int = 0):
        self._bytes = message.SerializeToString()
        self._numbers = [_all(self._bytes, struct.pack("<d", n)) for n in any_numbers(numbers)]
        self._points = 12 * points
        self.schema = type(message)

    @property
    def size(self) -> int:
        """Bytes of a message."""
        return len(self._bytes)

    @cached_property
    def _seconds(self) -> list[int]:
        return _all(self._bytes, _varints(np.array([_SECONDS])).tobytes())

    @cached_property
    def _nanos(self) -> list[int]:
        return _all(self._bytes, _varints(np.array([_NANOS])).tobytes())

    def fill(
        self,
        times: np.ndarray,
        numbers: np.ndarray | None = None,
        points: np.ndarray | None = None,
    ) -> np.ndarray:
        """N messages (N, size) uint8: times (N,) int64 [ns], numbers (N, K), points (N, P, 3)."""
        filled = np.empty((len(times), self.size), np.uint8)
        filled[:] = np.frombuffer(self._bytes, np.uint8)
        seconds, nanos = np.divmod(times, 10**9)
        for blanks, values in ((self._seconds, _varints(seconds)), (self._nanos, _varints(nanos))):
            for start in blanks:
                filled[:, start : start + 5] = values
        columns = np.zeros((len(times), 0)) if numbers is None else numbers
        for column, blanks in enumerate(self._numbers):
            values = np.ascontiguousarray(columns[:, column], "<f8").view(np.uint8).reshape(-1, 8)
            for start in blanks:
                filled[:, start : start + 8] = values
        if self._points:
            start = self._bytes.index(_POINT * (self._points // 4))
            values = np.ascontiguousarray(points, "<f4").reshape(len(times), -1)
            filled[:, start : start + self._points] = values.view(np.uint8)
        return filled


def _varints(values: np.ndarray) -> np.ndarray:
    """Protobuf's variable-length integers (N, 5) uint8 of values below 2^35, all five bytes long:
    readers take ones with leading zeros, and so a message's length does not depend on its time."""
    parts = (values[:, None] >> np.arange(0, 35, 7)) & 0x7F
    parts[:, :4] |= 0x80
    return parts.astype(np.uint8)


def _all(text: bytes, part: bytes) -> list[int]:
    """Every place where `part` begins."""
    found, place = [], text.find(part)
    while place >= 0:
        found.append(place)
        place = text.find(part, place + 1)
    return found
