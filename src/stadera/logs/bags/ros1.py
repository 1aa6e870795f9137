"""Reads ROS 1's bag files, format 2.0 (https://wiki.ros.org/Bags/Format/2.0), record by record."""

from __future__ import annotations

from collections.abc import Collection, Iterator
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
        """See `Container`."""
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
        """See `Container`."""
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
            path, _records(file, size), lambda record: _unpacked(*record, budget),
            lambda _: f"{file.tell()} of {size} bytes", damage, budget,
        )  # fmt: skip


def _records(file: BinaryIO, size: int) -> Iterator[tuple[int, Header, bytes]]:
    """Kind, header and data of each record of a file or chunk of this size."""
    from rosbags.rosbag1.reader import Header, read_bytes, read_uint32

    while file.tell() < size:
        header = Header.read(file)
        yield header.get_uint8("op"), header, read_bytes(file, read_uint32(file))


def _unpacked(kind: int, header: Header, data: bytes, budget: Budget) -> Iterator[_Connection | _Stored]:
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
        inner = unpacked(data, header.get_string("compression"), budget)
        for record in _records(BytesIO(inner), len(inner)):
            if record[0] != _CHUNK:
                yield from _unpacked(*record, budget)
