"""Splits an unpacked chunk of an MCAP file into its records (https://mcap.dev/spec).

A record is a byte that states its kind, eight with its length, and its content. A message's content begins with channel
(2 bytes), sequence number (4) and times of recording and of publishing (8 each). Messages are kept as places in the
chunk until it is known which of them are wanted.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
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
    """Some consecutive messages of a chunk: its data, and by channel and size the times of recording [ns] and the
    places of the messages' bytes.
    """

    data: bytes
    places: dict[tuple[int, int], tuple[list[int], list[int]]]

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
    """The schemas, channels and messages of a chunk; `checksum` is the stated one, 0 for none. RecordingError if it
    differs, or a record does not end within the chunk; the library raises errors of many kinds on damaged schemas and
    channels.
    """
    from mcap.data_stream import ReadDataStream
    from mcap.records import Channel, Schema

    if checksum and zlib.crc32(data) != checksum:
        raise RecordingError(f"crc validation failed in Chunk, expected: {checksum}, calculated: {zlib.crc32(data)}")
    readers: dict[int, Callable[[ReadDataStream], McapRecord]] = {_SCHEMA: Schema.read, _CHANNEL: Channel.read}
    found: list[McapRecord | Pieces] = []
    at = 0
    while at < len(data):
        kind, start, stop = _record(data, at)
        if kind == _STORED:
            piece, at = _piece(data, at)
            found.append(piece)
            continue
        if kind in readers:
            found.append(readers[kind](ReadDataStream(BytesIO(data[start:stop]))))
        at = stop
    return found


def _piece(data: bytes, at: int) -> tuple[Pieces, int]:
    """The consecutive messages from a place on, at most `_MOST`, and the place after them."""
    places: dict[tuple[int, int], tuple[list[int], list[int]]] = {}
    for _ in range(_MOST):
        kind, start, stop = _record(data, at)
        if kind != _STORED:
            break
        channel, _, time, _ = _MESSAGE.unpack_from(data, start)
        times, starts = places.setdefault((channel, stop - start - _MESSAGE.size), ([], []))
        times.append(time)
        starts.append(start + _MESSAGE.size)
        at = stop
        if at == len(data):
            break
    return Pieces(data, places), at


def _record(data: bytes, at: int) -> tuple[int, int, int]:
    """Kind of the record at a place, and where its content begins and ends."""
    kind, length = _RECORD.unpack_from(data, at)
    start = at + _RECORD.size
    if start + length > len(data) or (kind == _STORED and length < _MESSAGE.size):
        raise RecordingError("a record is not within its chunk, or shorter than any message")
    return kind, start, start + length
