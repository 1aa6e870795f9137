"""Reads the files of bags record by record: MCAP (https://mcap.dev/spec), ROS 1's format 2.0
(https://wiki.ros.org/Bags/Format/2.0) and rosbag2's sqlite3.
"""

from __future__ import annotations

import sqlite3
from collections.abc import Collection, Iterator
from contextlib import closing, suppress
from dataclasses import replace
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO, NamedTuple

from stadera.boundary import begins_with, foreign
from stadera.errors import RecordingError
from stadera.limits import Budget
from stadera.logs.bags.container import LATEST, Message, Topic, salvaged, unpacked

if TYPE_CHECKING:
    from mcap.records import McapRecord
    from rosbags.rosbag1.reader import Header


class McapFile:
    """Topics and messages of an MCAP file."""

    name, suffix, magic, encoding = "MCAP bag", ".mcap", b"\x89MCAP0\r\n", "cdr"

    def topics(self, path: Path, budget: Budget) -> dict[str, Topic]:
        """Topics of a file by name, those in `encoding`. Raises RecordingError: no part of it can be read."""
        from mcap.records import Channel, Schema

        if not begins_with(path, self.magic):
            raise RecordingError(f"{path}: not an MCAP file")
        parts: list[Any] = [*(_summary(path) or _mcap_records(path, [], budget))]
        types = {p.id: Topic(p.name, p.data.decode(errors="replace")) for p in parts if isinstance(p, Schema)}
        channels = [p for p in parts if isinstance(p, Channel) and p.message_encoding == self.encoding]
        found = {channel.topic: types[channel.schema_id] for channel in channels if channel.schema_id in types}
        if not found:
            raise RecordingError(f"{path}: no topics in CDR that can be read; is the file cut off?")
        return found

    def messages(self, path: Path, topics: Collection[str], damage: list[str], budget: Budget) -> Iterator[Message]:
        """Yields messages of these topics as recorded. Unreadable parts are skipped and reported in `damage`."""
        from mcap import records

        wanted: dict[int, str] = {}
        for record in _mcap_records(path, damage, budget):
            if isinstance(record, records.Message):
                if (topic := wanted.get(record.channel_id)) is not None:
                    yield Message(topic, min(record.log_time, LATEST), record.data)
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


def _mcap_records(path: Path, damage: list[str], budget: Budget) -> Iterator[McapRecord]:
    """Records in the file's order, those of chunks in their place."""
    from mcap.stream_reader import StreamReader

    size = path.stat().st_size
    with path.open("rb") as file:
        records = StreamReader(file, emit_chunks=True, record_size_limit=size).records
        yield from salvaged(
            path, records, lambda record: _mcap_unpacked(record, budget), lambda _: f"{file.tell()} of {size} bytes",
            damage, budget,
        )  # fmt: skip


def _mcap_unpacked(record: McapRecord, budget: Budget) -> list[McapRecord]:
    """A chunk's records, or the record itself. Raises ValueError: a chunk is not as its checksum says."""
    from mcap.records import Chunk
    from mcap.stream_reader import breakup_chunk

    if not isinstance(record, Chunk):
        return [record]
    data = unpacked(record.data, record.compression, budget.limits, f"{budget.path}: a chunk")
    return breakup_chunk(replace(record, compression="", data=data), validate_crc=True)


_MESSAGE, _CHUNK, _CONNECTION = 2, 5, 7
"""Operation codes of ROS 1's records."""


class _Connection(NamedTuple):
    number: int
    topic: str
    kind: Topic


class _Stored(NamedTuple):
    connection: int
    time: int
    data: bytes


class Ros1File:
    """Topics and messages of a .bag file."""

    name, suffix, magic, encoding = "ROS 1 bag", ".bag", b"#ROSBAG V2.0\n", "ros1"

    def topics(self, path: Path, budget: Budget) -> dict[str, Topic]:
        """See `McapFile`."""
        from rosbags.rosbag1 import Reader

        try:
            with Reader(path) as reader:
                return {c.topic: Topic(c.msgtype, c.msgdef.data) for c in reader.connections}
        except Exception:  # of many kinds, if the end is damaged; the records are read instead
            parts = _parts(path, [], budget)
            found = {part.topic: part.kind for part in parts if isinstance(part, _Connection)}
        if not found:
            raise RecordingError(f"{path}: no topics that can be read; is the file cut off?")
        return found

    def messages(self, path: Path, topics: Collection[str], damage: list[str], budget: Budget) -> Iterator[Message]:
        """See `McapFile`."""
        wanted: dict[int, str] = {}
        for part in _parts(path, damage, budget):
            if isinstance(part, _Stored):
                if (topic := wanted.get(part.connection)) is not None:
                    yield Message(topic, part.time, part.data)
            elif part.topic in topics:
                wanted[part.number] = part.topic


def _parts(path: Path, damage: list[str], budget: Budget) -> Iterator[_Connection | _Stored]:
    """Connections and messages in the file's order."""
    size = path.stat().st_size
    with path.open("rb") as file:
        file.readline()
        yield from salvaged(
            path, _ros1_records(file, size), lambda record: _ros1_unpacked(*record, budget),
            lambda _: f"{file.tell()} of {size} bytes", damage, budget,
        )  # fmt: skip


def _ros1_records(file: BinaryIO, size: int) -> Iterator[tuple[int, Header, bytes]]:
    """Kind, header and data of each record of a file or chunk of this size."""
    from rosbags.rosbag1.reader import Header, read_bytes, read_uint32

    while file.tell() < size:
        header = Header.read(file)
        yield header.get_uint8("op"), header, read_bytes(file, read_uint32(file))


def _ros1_unpacked(kind: int, header: Header, data: bytes, budget: Budget) -> Iterator[_Connection | _Stored]:
    """Parts of a record."""
    from rosbags.rosbag1.reader import Header
    from rosbags.typesys.msg import normalize_msgtype

    if kind == _MESSAGE:
        yield _Stored(header.get_uint32("conn"), header.get_time("time"), data)
    elif kind == _CONNECTION:
        fields = Header.read(BytesIO(len(data).to_bytes(4, "little") + data))
        described = Topic(normalize_msgtype(fields.get_string("type")), fields.get_string("message_definition"))
        yield _Connection(header.get_uint32("conn"), header.get_string("topic"), described)
    elif kind == _CHUNK:
        inner = unpacked(data, header.get_string("compression"), budget.limits, f"{budget.path}: a chunk")
        for record in _ros1_records(BytesIO(inner), len(inner)):
            if record[0] != _CHUNK:
                yield from _ros1_unpacked(*record, budget)


class SqliteFile:
    """Topics and messages of a .db3 file."""

    name, suffix, magic, encoding = "sqlite3 bag", ".db3", b"SQLite format 3\0", "cdr"

    def topics(self, path: Path, budget: Budget) -> dict[str, Topic]:
        """See `McapFile`."""
        definitions: dict[str, str] = {}
        try:
            with foreign(path, "no bag that can be read"), closing(_open(path, budget)) as database:
                rows = database.execute("SELECT name, type, serialization_format FROM topics").fetchall()
                with suppress(sqlite3.Error):  # older bags have no definitions
                    query = "SELECT topic_type, encoded_message_definition FROM message_definitions"
                    definitions = {kind: str(text) for kind, text in database.execute(query) if text}
        except RecordingError:
            budget.check_time()
            raise
        return {str(n): Topic(str(kind), definitions.get(kind, "")) for n, kind, form in rows if form == self.encoding}

    def messages(self, path: Path, topics: Collection[str], damage: list[str], budget: Budget) -> Iterator[Message]:
        """See `McapFile`."""
        return salvaged(path, _rows(path, topics, budget), _message, lambda read: f"{read} messages", damage, budget)


def _message(row: tuple[str, object, object]) -> tuple[Message]:
    """A row's message; the columns of a sqlite table hold values of any type."""
    topic, received, data = row
    if not (isinstance(received, int) and isinstance(data, bytes)):
        raise RecordingError(f"a message is {type(data).__name__} at {type(received).__name__}")
    return (Message(topic, received, data),)


def _rows(path: Path, topics: Collection[str], budget: Budget) -> Iterator[tuple[str, object, object]]:
    with closing(_open(path, budget)) as database:
        names = {number: str(name) for number, name in database.execute("SELECT id, name FROM topics")}
        wanted = [number for number, name in names.items() if name in topics]
        # in the order of the rows, which is that of recording: an index might be damaged
        query = (
            f"SELECT topic_id, timestamp, data FROM messages WHERE +topic_id IN ({','.join('?' * len(wanted))}) "
            "ORDER BY id"
        )
        for number, received, data in database.execute(query, wanted):
            yield names[number], received, data


def _open(path: Path, budget: Budget) -> sqlite3.Connection:
    """Opens the database such that no value is longer and no query takes longer than the budget allows. Raises
    RecordingError: topics or messages are not plain tables: a view or virtual table computes its rows, possibly without
    end.
    """
    database = sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro", uri=True)
    database.setlimit(
        sqlite3.SQLITE_LIMIT_LENGTH, min(int(budget.limits.unpacked), 1_000_000_000)
    )  # sqlite's own limit
    database.set_progress_handler(lambda: budget.is_over, 100_000)  # operations between two checks
    database.execute("PRAGMA trusted_schema=OFF")
    # without this, sqlite rejects a file that is shorter than its header states
    database.execute("PRAGMA writable_schema=ON")
    stored = dict(database.execute("SELECT name, type = 'table' AND rootpage > 0 FROM sqlite_master"))
    if computed := next((name for name in ("topics", "messages") if not stored.get(name, 1)), None):
        raise RecordingError(f"{path}: {computed} is no table but computed from others, which no recorder does")
    return database


Container = McapFile | Ros1File | SqliteFile
"""A bag's file format: its name for messages, file name suffix, first bytes, and encoding, "cdr" or "ros1"."""
