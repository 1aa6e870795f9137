"""Decodes JointState and Imu of ROS 2 by the positions of their numbers, while messages have the same layout.

In CDR a header is a stamp of 8 bytes and the frame's name. Everything up to the first number (including names of
joints) is the same in successive messages of a publisher, so the numbers keep their positions: doubles, aligned to 8
bytes after the four of the encapsulation. Other messages are passed to a decoder that reads every field.
"""

import struct
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stadera.logs.bags.container import Message, Messages, Sample, SampleBatch
from stadera.types import Array

_LITTLE = b"\0\1\0\0"
_STAMP = 12  # start of the frame's name: after encapsulation and stamp
_IMU = 37  # numbers: quaternion, rates and specific force, each followed by nine of its covariance
_IMU_ORDER = np.array([13, 14, 15, 25, 26, 27, 0, 1, 2, 3])
_UNKNOWN = ((16, slice(0, 3)), (28, slice(3, 6)), (4, slice(6, 10)))  # covariances that begin with -1, and their values


class Repeated:
    """A decoder that learns the layout of the next message from each message, read by `decode`: Imu messages if
    `is_imu`, JointState if not; None for others, of which every field is read.
    """

    def __init__(self, decode: Callable[[Message], Sample], *, is_imu: bool | None) -> None:
        self._decode, self._is_imu = decode, is_imu
        self._like: Sample | None = None
        self._prefix, self._length, self._first, self._count = b"", 0, 0, 0
        self._gaps: tuple[slice, ...] = ()
        self._joints = b""  # their number, as encoded before each array
        self._order: NDArray[np.intp] = _IMU_ORDER

    def __call__(self, message: Message) -> Sample:
        data, like = message.data, self._like
        if like is None or not self._is_laid_out_alike(data):
            sample = self._decode(message)
            self._learn(data, sample)
            return sample
        numbers = np.frombuffer(data, "<f8", self._count, self._first)
        values = numbers[self._order]
        if self._is_imu:
            _blank_unknown(values[None], numbers[None])
        seconds, nanoseconds = struct.unpack_from("<iI", data, 4)
        stamp = seconds * 1_000_000_000 + nanoseconds
        return like._replace(topic=message.topic, received=message.received, stamp=stamp, values=values)

    def many(self, messages: Messages) -> SampleBatch | None:
        """See `Decoder`; None before the first message and if one of them is laid out in another way."""
        rows, like = messages.data, self._like
        if like is None or rows.shape[1] != self._length:
            return None
        parts = [(slice(0, 4), _LITTLE), (slice(_STAMP, self._first), self._prefix)]
        parts += [(gap, self._joints) for gap in self._gaps]
        if not all((rows[:, part] == np.frombuffer(known, np.uint8)).all() for part, known in parts):
            return None
        numbers = np.ascontiguousarray(rows[:, self._first : self._first + 8 * self._count]).view("<f8")
        values = numbers[:, self._order]
        if self._is_imu:
            _blank_unknown(values, numbers)
        times = np.ascontiguousarray(rows[:, 4:_STAMP])
        stamps = times.view("<i4")[:, 0].astype(np.int64) * 1_000_000_000 + times.view("<u4")[:, 1]
        return SampleBatch(messages.topic, messages.received, stamps, like.frame, like.columns, values)

    def _is_laid_out_alike(self, data: bytes) -> bool:
        return (
            len(data) == self._length
            and data[:4] == _LITTLE
            and data[_STAMP : self._first] == self._prefix
            and all(data[gap] == self._joints for gap in self._gaps)
        )

    def _learn(self, data: bytes, sample: Sample) -> None:
        """Determines the numbers' positions in the next message, if it has the same layout."""
        self._like = None
        if data[:4] != _LITTLE or self._is_imu is None:
            return
        joints = 0 if self._is_imu else len(sample.columns) // 3
        # the second and third array are preceded by 8 bytes with their length
        count = _IMU if self._is_imu else 3 * joints + 2
        first = len(data) - 8 * count
        if (first - 4) % 8 or first <= _STAMP or not (joints or self._is_imu):
            return  # more data follows, or an array is empty
        self._prefix, self._length, self._first, self._count = data[_STAMP:first], len(data), first, count
        if not self._is_imu:
            self._joints = struct.pack("<I", joints)
            starts = (first - 8, first + 8 * joints, first + 16 * joints + 8)
            self._gaps = tuple(slice(start, start + 4) for start in starts[1:])
            self._order = np.delete(np.arange(count), [joints, 2 * joints + 1])
        if self._is_laid_out_alike(data):
            self._like = sample


def _blank_unknown(values: Array, numbers: NDArray[Any]) -> None:
    """Sets values (n, 10) that sensor_msgs/Imu marks as unknown, by a covariance or a quaternion of zeros, to NaN."""
    for covariance, part in _UNKNOWN:
        values[numbers[:, covariance] == -1.0, part] = np.nan
    values[~values[:, 6:].any(axis=1), 6:] = np.nan
