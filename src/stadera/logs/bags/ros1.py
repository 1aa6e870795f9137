"""Reads ROS 1's bag files, format 2.0 (https://wiki.ros.org/Bags/Format/2.0), record by record."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from functools import partial
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO, NamedTuple

from stadera.errors import RecordingError
from stadera.limits import Budget
from stadera.logs.bags.container import Message, Topic, salvaged, unpacked

if TYPE_CHECKING:
    from rosbags.rosbag1.reader import Header

_MESSAGE, _CHUNK, _CONNECTION = 2, 5, 7
"""Operation codes of records."""


class _Record(NamedTuple):
    kind: int
    header: Header
    data: bytes


class _Part(NamedTuple):
    """A connection (topic and type), or a message (time [ns] and data)."""

    connection: int
    topic: str = ""
    type: str = ""
    definition: str = ""
    time: int = 0
    data: bytes = b""


class Ros1File:
    """Topics and messages of a .bag file."""

    name, suffix, magic, encoding = "ROS 1 bag", ".bag", b"#ROSBAG V2.0\n", "ros1"

    def topics(self, path: Path, budget: Budget) -> dict[str, Topic]:
        """See `Container`."""
        from rosbags.rosbag1 import Reader
        from rosbags.typesys.msg import normalize_msgtype

        try:
            with Reader(path) as reader:
                return {c.topic: Topic(c.msgtype, c.msgdef.data) for c in reader.connections}
        except Exception:  # of many kinds, if the end is damaged; the records are read instead
            connections = [part for part in _parts(path, [], budget) if part.topic]
            found = {part.topic: Topic(normalize_msgtype(part.type), part.definition) for part in connections}
        if not found:
            raise RecordingError(f"{path}: no topics that can be read; is the file cut off?")
        return found

    def messages(self, path: Path, topics: Collection[str], damage: list[str], budget: Budget) -> Iterator[Message]:
        """See `Container`."""
        wanted: dict[int, str] = {}
        for part in _parts(path, damage, budget):
            if part.topic in topics:
                wanted[part.connection] = part.topic
            elif not part.topic and (topic := wanted.get(part.connection)) is not None:
                yield Message(topic, part.time, part.data)


def _parts(path: Path, damage: list[str], budget: Budget) -> Iterator[_Part]:
    """Connections and messages in the file's order."""
    size = path.stat().st_size
    with path.open("rb") as file:
        file.readline()
        records, unpack = _records(file, size), partial(_unpacked, budget=budget)
        yield from salvaged(path, records, unpack, lambda _: f"{file.tell()} of {size} bytes", damage, budget)


def _unpacked(record: _Record, budget: Budget) -> list[_Part]:
    if record.kind != _CHUNK:
        return _parts_of(record)
    inner = unpacked(record.data, record.header.get_string("compression"), budget)
    return [part for record in _records(BytesIO(inner), len(inner)) for part in _parts_of(record)]


def _parts_of(record: _Record) -> list[_Part]:
    """Parts of a record that is not a chunk."""
    from rosbags.rosbag1.reader import Header

    kind, header, data = record
    if kind == _MESSAGE:
        return [_Part(header.get_uint32("conn"), time=header.get_time("time"), data=data)]
    if kind == _CONNECTION:
        fields = Header.read(BytesIO(len(data).to_bytes(4, "little") + data))
        described = fields.get_string("type"), fields.get_string("message_definition")
        return [_Part(header.get_uint32("conn"), header.get_string("topic"), *described)]
    return []


def _records(file: BinaryIO, size: int) -> Iterator[_Record]:
    from rosbags.rosbag1.reader import Header, read_bytes, read_uint32

    while file.tell() < size:
        header = Header.read(file)
        yield _Record(header.get_uint8("op"), header, read_bytes(file, read_uint32(file)))
