"""Splits an unpacked chunk of an MCAP file into its records (https://mcap.dev/spec).

A record is a byte that states its kind, eight with its length, and its content. A message's content begins with channel
(2 bytes), sequence number (4) and times of recording and of publishing (8 each). Messages are kept as places in the
chunk until it is known which of them are wanted.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from io import BytesIO
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from stadera.errors import RecordingError
from stadera.logs.bags.container import Bundle, Messages

if TYPE_CHECKING:
    from mcap.records import McapRecord

_RECORD, _MESSAGE = struct.Struct("<BQ"), struct.Struct("<HIQQ")
_SCHEMA, _CHANNEL, _STORED = 3, 4, 5
_MOST = 4096  # messages in a piece, which bounds how far topics can be out of order


@dataclass(frozen=True, eq=False)
class Pieces:
    """Some consecutive messages of a chunk.

    Attributes:
        data: of the chunk.
        places: by channel and size, the times of recording [ns] and the places of the messages' bytes.
    """

    data: bytes
    places: dict[tuple[int, int], tuple[list[int], list[int]]] = field(default_factory=dict)

    def of(self, topics: Mapping[int, str]) -> Bundle:
        """The messages of these topics, by channel."""
        return Bundle(
            tuple(
                Messages(topics[channel], _nanoseconds(times), self._bytes(starts, size))
                for (channel, size), (times, starts) in self.places.items()
                if channel in topics
            )
        )

    def _bytes(self, starts: list[int], size: int) -> NDArray[np.uint8]:
        joined = b"".join([self.data[start : start + size] for start in starts])
        return np.frombuffer(joined, np.uint8).reshape(len(starts), size)


def _nanoseconds(times: list[int]) -> NDArray[np.int64]:
    """Signed times; those beyond any clock's stay so."""
    return np.minimum(np.array(times, dtype=np.uint64), np.uint64(1 << 62)).astype(np.int64)


def split(data: bytes, checksum: int) -> list[McapRecord | Pieces]:
    """The schemas, channels and messages of a chunk; `checksum` is the stated one, 0 for none.

    Raises:
        RecordingError: the checksum differs, or a record does not end within the chunk. The library raises errors of
            many kinds on damaged schemas and channels.
    """
    from mcap.data_stream import ReadDataStream
    from mcap.records import Channel, Schema

    if checksum and zlib.crc32(data) != checksum:
        raise RecordingError(f"crc validation failed in Chunk, expected: {checksum}, calculated: {zlib.crc32(data)}")
    found: list[McapRecord | Pieces] = []
    piece, count, at, end = Pieces(data), 0, 0, len(data)
    while at < end:
        kind, length = _RECORD.unpack_from(data, at)
        start, at = at + _RECORD.size, at + _RECORD.size + length
        if at > end or (kind == _STORED and length < _MESSAGE.size):
            raise RecordingError("a record is not within its chunk, or shorter than any message")
        if kind == _STORED:
            channel, _, time, _ = _MESSAGE.unpack_from(data, start)
            key = channel, length - _MESSAGE.size
            if (places := piece.places.get(key)) is None:
                places = piece.places[key] = ([], [])
            places[0].append(time)
            places[1].append(start + _MESSAGE.size)
            count += 1
            if count == _MOST:
                found, piece, count = [*found, piece], Pieces(data), 0
        elif kind in (_SCHEMA, _CHANNEL):
            if piece.places:
                found, piece, count = [*found, piece], Pieces(data), 0
            found.append((Schema if kind == _SCHEMA else Channel).read(ReadDataStream(BytesIO(data[start:at]))))
    return [*found, piece] if piece.places else found
