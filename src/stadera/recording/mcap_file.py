"""MCAP files, read record by record, so that one that is cut off or damaged is read as far as it goes."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from pathlib import Path

from mcap.reader import SeekingReader
from mcap.records import Channel, Chunk, McapRecord, Schema
from mcap.records import Message as McapMessage
from mcap.stream_reader import StreamReader, breakup_chunk

from stadera.errors import RecordingError
from stadera.recording.bag import Message

MAGIC = b"\x89MCAP0\r\n"
ENCODING = "cdr"


class McapStorage:
    """Topics and messages of an MCAP file."""

    def topics(self, path: Path) -> dict[str, str]:
        """See `stadera.recording.bag.Storage`."""
        with path.open("rb") as file:
            if file.read(len(MAGIC)) != MAGIC:
                raise RecordingError(f"{path}: not an MCAP file")
        found = _topics_of(_summary(path) or list(_records(path, [], only_channels=True)))
        if not found:
            raise RecordingError(f"{path}: no topics in {ENCODING.upper()} that can be read; is the file cut off?")
        return found

    def messages(self, path: Path, topics: Collection[str], damage: list[str]) -> Iterator[Message]:
        """See `stadera.recording.bag.Storage`."""
        wanted: dict[int, str] = {}
        for record in _records(path, damage):
            if isinstance(record, McapMessage):
                if (topic := wanted.get(record.channel_id)) is not None:
                    yield Message(topic, record.log_time, record.data)
            elif isinstance(record, Channel) and record.topic in topics and record.message_encoding == ENCODING:
                wanted[record.id] = record.topic


def _topics_of(records: list[McapRecord]) -> dict[str, str]:
    types = {record.id: record.name for record in records if isinstance(record, Schema)}
    channels = [r for r in records if isinstance(r, Channel) and r.message_encoding == ENCODING]
    return {channel.topic: types[channel.schema_id] for channel in channels if channel.schema_id in types}


def _summary(path: Path) -> list[McapRecord]:
    """Schemas and channels by the file's index; none where it has no index that can be read."""
    try:
        with path.open("rb") as file:
            summary = SeekingReader(file).get_summary()
    except Exception:  # whatever the library makes of a damaged end: the records themselves are looked at instead
        return []
    return [] if summary is None else [*summary.schemas.values(), *summary.channels.values()]


def _records(path: Path, damage: list[str], *, only_channels: bool = False) -> Iterator[McapRecord]:
    """Schemas, channels and messages in the file's order; chunks that cannot be unpacked are left out, and told."""
    with path.open("rb") as file:
        reader = StreamReader(file, emit_chunks=True, record_size_limit=path.stat().st_size)
        records = reader.records
        broken, reason = 0, ""
        while True:
            try:
                record = next(records, None)
            except Exception as error:  # the library meets damaged bytes with errors of many kinds
                damage.append(
                    f"{path}: cut off or damaged after {file.tell()} of {path.stat().st_size} bytes"
                    f"{_said(error)}; read up to there"
                )
                break
            if record is None:
                break
            if not isinstance(record, Chunk):
                yield record
                continue
            try:
                inner = breakup_chunk(record, validate_crc=True)
            except Exception as error:
                broken, reason = broken + 1, _said(error)
                continue
            yield from (r for r in inner if not (only_channels and isinstance(r, McapMessage)))
        if broken:
            damage.append(f"{path}: left out {broken} damaged chunk{'s' * (broken > 1)} of messages{reason}")


def _said(error: Exception) -> str:
    text = " ".join(str(error).split())[:100]
    return f" ({text})" if text else ""
