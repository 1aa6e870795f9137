"""Reads MCAP files (https://mcap.dev/spec) record by record."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Collection, Iterator
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO, NamedTuple

from stadera.boundary import begins_with
from stadera.errors import RecordingError
from stadera.limits import Budget
from stadera.logs.bags.container import Message, Topic, salvaged, unpacked

if TYPE_CHECKING:
    from mcap.records import Channel, Schema

_FOOTER, _SCHEMA, _CHANNEL, _MESSAGE, _CHUNK = 2, 3, 4, 5, 6
"""Operation codes of records."""
_RECORD = struct.Struct("<BQ")  # operation code and length of the content
_HEAD = struct.Struct("<HIQQ")  # of a message: channel, number, times of recording and of publishing [ns]
_LATEST = 1 << 62  # time beyond any clock's [ns]


class _Stored(NamedTuple):
    channel: int
    time: int
    data: bytes


class McapFile:
    """Topics and messages of an MCAP file."""

    name, suffix, magic, encoding = "MCAP bag", ".mcap", b"\x89MCAP0\r\n", "cdr"

    def topics(self, path: Path, budget: Budget) -> dict[str, Topic]:
        """See `Container`."""
        from mcap.records import Channel, Schema

        if not begins_with(path, self.magic):
            raise RecordingError(f"{path}: not an MCAP file")
        parts = [*(_summary(path) or _parts(path, [], budget))]
        types = {p.id: Topic(p.name, p.data.decode(errors="replace")) for p in parts if isinstance(p, Schema)}
        channels = [p for p in parts if isinstance(p, Channel) and p.message_encoding == self.encoding]
        found = {channel.topic: types[channel.schema_id] for channel in channels if channel.schema_id in types}
        if not found:
            raise RecordingError(f"{path}: no topics in CDR that can be read; is the file cut off?")
        return found

    def messages(self, path: Path, topics: Collection[str], damage: list[str], budget: Budget) -> Iterator[Message]:
        """See `Container`."""
        from mcap.records import Channel

        wanted: dict[int, str] = {}
        for part in _parts(path, damage, budget):
            if isinstance(part, _Stored):
                if (topic := wanted.get(part.channel)) is not None:
                    yield Message(topic, part.time, part.data)
            elif isinstance(part, Channel) and part.topic in topics and part.message_encoding == self.encoding:
                wanted[part.id] = part.topic


def _summary(path: Path) -> list[Schema | Channel | _Stored]:
    """Schemas and channels from the file's index; empty if it has no readable one."""
    from mcap.reader import SeekingReader

    try:
        with path.open("rb") as file:
            summary = SeekingReader(file).get_summary()
    except Exception:  # of many kinds, if the end is damaged; the records are read instead
        return []
    return [] if summary is None else [*summary.schemas.values(), *summary.channels.values()]


def _parts(path: Path, damage: list[str], budget: Budget) -> Iterator[Schema | Channel | _Stored]:
    """Schemas, channels and messages in the file's order."""
    size = path.stat().st_size
    with path.open("rb") as file:
        file.seek(len(McapFile.magic))
        yield from salvaged(
            path, _stored(file, size), lambda record: _unpacked(*record, budget),
            lambda _: f"{file.tell()} of {size} bytes", damage, budget,
        )  # fmt: skip


def _stored(file: BinaryIO, size: int) -> Iterator[tuple[int, bytes]]:
    """Records of a file up to its footer."""
    for kind, content in _records(file, size):
        if kind == _FOOTER:
            return
        yield kind, content
    raise RecordingError("the end is missing")


def _records(file: BinaryIO, size: int) -> Iterator[tuple[int, bytes]]:
    """Kind and content of each record of a file or chunk of this size; indices and attachments are skipped."""
    while head := file.read(_RECORD.size):
        kind, length = _RECORD.unpack(head)
        if length > size:
            raise RecordingError("a record is not within its file or chunk")
        if kind > _CHUNK:
            file.seek(length, 1)
            continue
        content = file.read(length)
        if len(content) < length:
            raise RecordingError("a record is not within its file or chunk")
        yield kind, content


def _unpacked(kind: int, content: bytes, budget: Budget) -> Iterator[Schema | Channel | _Stored]:
    """Parts of a record. Raises RecordingError: a chunk is not as its checksum says."""
    from mcap.data_stream import ReadDataStream
    from mcap.records import Channel, Chunk, Schema

    if kind == _MESSAGE:
        channel, _, time, _ = _HEAD.unpack_from(content)
        yield _Stored(channel, min(time, _LATEST), content[_HEAD.size :])
    elif kind == _SCHEMA:
        yield Schema.read(ReadDataStream(BytesIO(content)))
    elif kind == _CHANNEL:
        yield Channel.read(ReadDataStream(BytesIO(content)))
    elif kind == _CHUNK:
        chunk = Chunk.read(ReadDataStream(BytesIO(content)))
        data = unpacked(chunk.data, chunk.compression, budget)
        if chunk.uncompressed_crc not in (0, zlib.crc32(data)):
            raise RecordingError(f"checksum {chunk.uncompressed_crc} of a chunk is {zlib.crc32(data)}")
        for inner, inside in _records(BytesIO(data), len(data)):
            if inner != _CHUNK:
                yield from _unpacked(inner, inside, budget)
