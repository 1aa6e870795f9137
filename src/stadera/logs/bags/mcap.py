"""Reads MCAP files (https://mcap.dev/spec) record by record."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from stadera.boundary import begins_with
from stadera.errors import RecordingError
from stadera.limits import Budget
from stadera.logs.bags.container import Message, Topic, salvaged, unpacked

if TYPE_CHECKING:
    from mcap.records import McapRecord

_LATEST = 1 << 62  # time beyond any clock's [ns]


class McapFile:
    """Topics and messages of an MCAP file."""

    name, suffix, magic, encoding = "MCAP bag", ".mcap", b"\x89MCAP0\r\n", "cdr"

    def topics(self, path: Path, budget: Budget) -> dict[str, Topic]:
        """See `Container`."""
        from mcap.records import Channel, Schema

        if not begins_with(path, self.magic):
            raise RecordingError(f"{path}: not an MCAP file")
        parts: list[Any] = [*(_summary(path) or _records(path, [], budget))]
        types = {p.id: Topic(p.name, p.data.decode(errors="replace")) for p in parts if isinstance(p, Schema)}
        channels = [p for p in parts if isinstance(p, Channel) and p.message_encoding == self.encoding]
        found = {channel.topic: types[channel.schema_id] for channel in channels if channel.schema_id in types}
        if not found:
            raise RecordingError(f"{path}: no topics in CDR that can be read; is the file cut off?")
        return found

    def messages(self, path: Path, topics: Collection[str], damage: list[str], budget: Budget) -> Iterator[Message]:
        """See `Container`."""
        from mcap import records

        wanted: dict[int, str] = {}
        for record in _records(path, damage, budget):
            if isinstance(record, records.Message):
                if (topic := wanted.get(record.channel_id)) is not None:
                    yield Message(topic, min(record.log_time, _LATEST), record.data)
            elif isinstance(record, records.Channel) and record.message_encoding == self.encoding:
                wanted |= {record.id: record.topic} if record.topic in topics else {}


def _summary(path: Path) -> list[McapRecord]:
    """Schemas and channels from the file's index; empty if it has no readable one."""
    from mcap.reader import SeekingReader

    try:
        with path.open("rb") as file:
            summary = SeekingReader(file).get_summary()
    except Exception:  # of many kinds, if the end is damaged; the records are read instead
        return []
    return [] if summary is None else [*summary.schemas.values(), *summary.channels.values()]


def _records(path: Path, damage: list[str], budget: Budget) -> Iterator[McapRecord]:
    """Records in the file's order, those of chunks in their place."""
    from mcap.stream_reader import StreamReader

    size = path.stat().st_size
    with path.open("rb") as file:
        records = StreamReader(file, emit_chunks=True, record_size_limit=size).records
        yield from salvaged(
            path, records, lambda record: _unpacked(record, budget), lambda _: f"{file.tell()} of {size} bytes",
            damage, budget,
        )  # fmt: skip


def _unpacked(record: McapRecord, budget: Budget) -> list[McapRecord]:
    """A chunk's records, or the record itself. Raises ValueError: a chunk is not as its checksum says."""
    from mcap.records import Chunk
    from mcap.stream_reader import breakup_chunk

    if not isinstance(record, Chunk):
        return [record]
    data = unpacked(record.data, record.compression, budget)
    return breakup_chunk(replace(record, compression="", data=data), validate_crc=True)
