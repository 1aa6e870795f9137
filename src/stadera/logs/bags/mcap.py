"""Reads MCAP files record by record, and the messages of a chunk at once."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

from stadera.boundary import begins_with
from stadera.errors import RecordingError
from stadera.limits import Budget
from stadera.logs.bags.container import Bundle, Message, Topic, salvaged, unpacked
from stadera.logs.bags.mcap_chunk import Pieces, split

if TYPE_CHECKING:
    from mcap.records import McapRecord


class McapFile:
    """Topics and messages of an MCAP file."""

    name, suffix, magic, encoding = "MCAP bag", ".mcap", b"\x89MCAP0\r\n", "cdr"

    def topics(self, path: Path, budget: Budget) -> dict[str, Topic]:
        """See `Container`."""
        from mcap.records import Channel, Schema

        if not begins_with(path, self.magic):
            raise RecordingError(f"{path}: not an MCAP file")
        records: list[McapRecord | Pieces] = [*(_summary(path) or _records(path, [], budget, only_channels=True))]
        types = {r.id: Topic(r.name, r.data.decode(errors="replace")) for r in records if isinstance(r, Schema)}
        channels = [r for r in records if isinstance(r, Channel) and r.message_encoding == self.encoding]
        found = {channel.topic: types[channel.schema_id] for channel in channels if channel.schema_id in types}
        if not found:
            raise RecordingError(f"{path}: no topics in CDR that can be read; is the file cut off?")
        return found

    def messages(
        self, path: Path, topics: Collection[str], damage: list[str], budget: Budget
    ) -> Iterator[Message | Bundle]:
        """See `Container`."""
        from mcap.records import Channel
        from mcap.records import Message as Stored

        wanted: dict[int, str] = {}
        for record in _records(path, damage, budget):
            if isinstance(record, Pieces):
                yield record.of(wanted)
            elif isinstance(record, Stored):
                if (topic := wanted.get(record.channel_id)) is not None:
                    yield Message(topic, record.log_time, record.data)
            elif isinstance(record, Channel) and record.topic in topics and record.message_encoding == self.encoding:
                wanted[record.id] = record.topic


def _summary(path: Path) -> list[McapRecord]:
    """Schemas and channels from the file's index; empty if it has no readable one."""
    from mcap.reader import SeekingReader

    try:
        with path.open("rb") as file:
            summary = SeekingReader(file).get_summary()
    except Exception:  # of many kinds, if the end is damaged; the records are read instead
        return []
    return [] if summary is None else [*summary.schemas.values(), *summary.channels.values()]


def _records(
    path: Path, damage: list[str], budget: Budget, *, only_channels: bool = False
) -> Iterator[McapRecord | Pieces]:
    """Schemas, channels and messages in the file's order."""
    from mcap.records import Chunk

    size = path.stat().st_size

    def unpack(record: McapRecord) -> list[McapRecord | Pieces]:
        if not isinstance(record, Chunk):
            return [record]
        inner = split(unpacked(record.data, record.compression, budget), record.uncompressed_crc)
        return [r for r in inner if not isinstance(r, Pieces)] if only_channels else inner

    with path.open("rb") as file:
        yield from salvaged(
            path, _stored(file, size), unpack, lambda _: f"{file.tell()} of {size} bytes", damage, budget
        )


def _stored(file: BinaryIO, size: int) -> Iterator[McapRecord]:
    """The records of a file up to its footer that lead to messages; indices are skipped."""
    from mcap.data_stream import ReadDataStream
    from mcap.exceptions import RecordLengthLimitExceeded
    from mcap.opcode import Opcode
    from mcap.records import Channel, Chunk, Message, Schema
    from mcap.stream_reader import read_magic

    kinds: dict[int, Any] = {int(Opcode.CHUNK): Chunk, int(Opcode.CHANNEL): Channel, int(Opcode.SCHEMA): Schema}
    stream = ReadDataStream(file)
    read_magic(stream)
    while True:
        opcode, length = stream.read1(), stream.read8()
        if length > size:
            raise RecordLengthLimitExceeded(opcode, length, size)
        if opcode in kinds:
            yield kinds[opcode].read(ReadDataStream(BytesIO(stream.read(length))))
        elif opcode == Opcode.MESSAGE:
            yield Message.read(stream, length)
        else:
            file.seek(length, 1)
        if opcode == Opcode.FOOTER:
            read_magic(stream)
            return
