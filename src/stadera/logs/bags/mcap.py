"""Reads MCAP files record by record."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from stadera.errors import RecordingError
from stadera.limits import Budget
from stadera.logs.bags.container import Message, Topic, salvaged
from stadera.logs.bags.unpack import unpacked

if TYPE_CHECKING:
    from mcap.records import McapRecord


class McapFile:
    """Topics and messages of an MCAP file."""

    name, suffix, magic, encoding = "MCAP bag", ".mcap", b"\x89MCAP0\r\n", "cdr"

    def topics(self, path: Path, budget: Budget) -> dict[str, Topic]:
        """See `Container`."""
        from mcap.records import Channel, Schema

        with path.open("rb") as file:
            if file.read(len(self.magic)) != self.magic:
                raise RecordingError(f"{path}: not an MCAP file")
        records = _summary(path) or list(_records(path, [], budget, only_channels=True))
        types = {r.id: Topic(r.name, r.data.decode(errors="replace")) for r in records if isinstance(r, Schema)}
        channels = [r for r in records if isinstance(r, Channel) and r.message_encoding == self.encoding]
        found = {channel.topic: types[channel.schema_id] for channel in channels if channel.schema_id in types}
        if not found:
            raise RecordingError(f"{path}: no topics in CDR that can be read; is the file cut off?")
        return found

    def messages(self, path: Path, topics: Collection[str], damage: list[str], budget: Budget) -> Iterator[Message]:
        """See `Container`."""
        from mcap.records import Channel
        from mcap.records import Message as Stored

        wanted: dict[int, str] = {}
        for record in _records(path, damage, budget):
            if isinstance(record, Stored):
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


def _records(path: Path, damage: list[str], budget: Budget, *, only_channels: bool = False) -> Iterator[McapRecord]:
    """Schemas, channels and messages in the file's order."""
    from mcap.records import Chunk
    from mcap.records import Message as Stored
    from mcap.stream_reader import StreamReader, breakup_chunk

    size = path.stat().st_size

    def unpack(record: McapRecord) -> list[McapRecord]:
        if not isinstance(record, Chunk):
            return [record]
        data = unpacked(record.data, record.compression, budget)
        inner = breakup_chunk(replace(record, compression="", data=data), validate_crc=True)
        return [r for r in inner if not isinstance(r, Stored)] if only_channels else inner

    with path.open("rb") as file:
        records = StreamReader(file, emit_chunks=True, record_size_limit=size).records
        yield from salvaged(path, records, unpack, lambda _: f"{file.tell()} of {size} bytes", damage, budget)
