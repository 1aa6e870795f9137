"""Files of a bag: topics and messages of one file or a folder; damaged files are read as far as possible."""

import re
from collections.abc import Callable, Collection, Iterable, Iterator
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import NamedTuple, Protocol, Self, TypeVar

import numpy as np
from numpy.typing import NDArray

from stadera.errors import RecordingError
from stadera.limits import DEFAULTS, Budget, LimitError, Limits
from stadera.types import Array

Record = TypeVar("Record")
Part = TypeVar("Part")


class Message(NamedTuple):
    """One message as stored: its topic, when it was recorded [ns], and its bytes."""

    topic: str
    received: int
    data: bytes


class Messages(NamedTuple):
    """Messages of one topic with equally many bytes: when they were recorded (n,) [ns], and their bytes (n, size)."""

    topic: str
    received: NDArray[np.int64]
    data: NDArray[np.uint8]

    def each(self) -> Iterator[Message]:
        """Yields the messages one by one."""
        for received, data in zip(self.received.tolist(), self.data, strict=True):
            yield Message(self.topic, received, data.tobytes())


class Bundle(NamedTuple):
    """Consecutive messages, by topic and size; their order is kept only among those of one topic and size."""

    groups: tuple[Messages, ...]

    def each(self) -> Iterator[Message]:
        """Yields the messages one by one."""
        for group in self.groups:
            yield from group.each()


class Sample(NamedTuple):
    """The values (columns,) of one message, NaN where it marks them as unknown, and the columns' names in the flat
    table; when it was recorded and measured [ns]; the frame of the IMU, without a leading slash, may be empty.
    """

    topic: str
    received: int
    stamp: int
    frame: str
    columns: tuple[str, ...]
    values: Array


class SampleBatch(NamedTuple):
    """The values of several messages of one topic, like `Sample` with arrays (n,) and values (n, columns)."""

    topic: str
    received: NDArray[np.int64]
    stamp: NDArray[np.int64]
    frame: str
    columns: tuple[str, ...]
    values: Array


class Topic(NamedTuple):
    """Message type of a topic, in ROS 2's notation, and its definition; empty if the file has none."""

    kind: str
    definition: str = ""


class Container(Protocol):
    """Protocol of a bag's file format: its name for messages, file name suffix, first bytes, and encoding, "cdr" or
    "ros1".
    """

    name: str
    suffix: str
    magic: bytes
    encoding: str

    def topics(self, path: Path, budget: Budget) -> dict[str, Topic]:
        """Topics of a file by name, restricted to those in `encoding`. Raises RecordingError: no part of the file can
        be read.
        """
        ...

    def messages(
        self, path: Path, topics: Collection[str], damage: list[str], budget: Budget
    ) -> Iterator[Message | Bundle]:
        """Yields messages of these topics as recorded. Unreadable parts are skipped and reported in `damage`."""
        ...


@dataclass
class Bag:
    """The files of a bag, in order, their format, the limits for reading them, and the parts that could not be read,
    one sentence each; these grow while messages are read.
    """

    path: Path
    container: Container
    files: tuple[Path, ...]
    budget: Budget
    damage: list[str] = field(default_factory=list)

    @classmethod
    def at(cls, path: Path, container: Container, limits: Limits = DEFAULTS) -> Self:
        """Opens a file, or a folder's files in the order of the numbers in their names. Raises RecordingError: a file
        of the folder is compressed as a whole.
        """
        if not path.is_dir():
            return cls(path, container, (path,), Budget(path, limits))
        there, suffix = sorted(path.iterdir(), key=_in_order), container.suffix
        if packed := next((p for p in there if p.name.endswith((f"{suffix}.zstd", f"{suffix}.zst"))), None):
            raise RecordingError(f"{packed}: compressed as a whole; unpack it first: zstd -d {packed.name}")
        files = tuple(p for p in there if p.suffix == suffix and p.is_file())
        missing = _missing_parts(files)
        return cls(path, container, files, Budget(path, limits), [missing] if missing else [])

    def topics(self) -> dict[str, Topic]:
        """Topics of all files. Raises RecordingError: no file can be read."""
        found: dict[str, Topic] = {}
        errors: dict[Path, RecordingError] = {}
        for path in self.files:
            try:
                found |= self.container.topics(path, self.budget)
            except RecordingError as error:
                errors[path] = error
        if len(errors) == len(self.files):
            raise next(iter(errors.values()))
        self.files = tuple(path for path in self.files if path not in errors)
        self.damage += map(str, errors.values())
        return found

    def messages(self, topics: Collection[str]) -> Iterator[Message | Bundle]:
        """Yields all messages of these topics, file after file."""
        for path in self.files:
            yield from self.container.messages(path, topics, self.damage, self.budget)

    def each(self, topics: Collection[str]) -> Iterator[Message]:
        """Yields all messages of these topics one by one."""
        for item in self.messages(topics):
            if isinstance(item, Bundle):
                yield from item.each()
            else:
                yield item


def salvaged(
    path: Path,
    records: Iterator[Record],
    unpack: Callable[[Record], Iterable[Part]],
    read_so_far: Callable[[int], str],
    damage: list[str],
    budget: Budget,
) -> Iterator[Part]:
    """Yields the parts of a file's records, as far as they can be read, within a budget, else LimitError.

    The libraries raise errors of many kinds on damaged bytes: all are caught here.

    Args:
        records: in the file's order. An error ends them, since the next record cannot be located.
        unpack: splits a record into parts: a chunk into its messages, others into themselves. On an error the record is
            skipped.
        read_so_far: describes how much of the file was read, given the number of records, for the report.
        damage: receives a sentence for each part that could not be read.
    """
    read, broken, reason = 0, 0, ""
    while True:
        budget.tick()
        try:
            record = next(records, None)
        except LimitError:
            raise
        except Exception as error:
            budget.check_time()
            damage.append(f"{path}: cut off or damaged after {read_so_far(read)}{_why(error)}; read up to there")
            break
        if record is None:
            break
        read += 1
        try:
            inner = unpack(record)
        except LimitError:
            raise
        except Exception as error:
            broken, reason = broken + 1, _why(error)
            continue
        yield from inner
    if broken:
        damage.append(f"{path}: left out {broken} damaged chunk{'s' * (broken > 1)} of messages{reason}")


def _why(error: Exception) -> str:
    text = " ".join(str(error).split())[:100]
    return f" ({text})" if text else ""


def _missing_parts(files: Collection[Path]) -> str:
    """A sentence on missing numbers in a bag's file names; empty if there are none."""
    numbered = [int(m.group(1)) for p in files if (m := re.search(r"_(\d+)$", p.stem))]
    left_out = sorted(set(range(max(numbered, default=-1) + 1)) - set(numbered))
    return f"parts of the bag are missing: number {', '.join(map(str, left_out))}" if left_out else ""


def _in_order(path: Path) -> tuple[tuple[int, str], ...]:
    return tuple((int(part), "") if part.isdigit() else (-1, part) for part in re.split(r"(\d+)", path.name))


_PIECE = 1 << 20  # bytes unpacked at a time


class _Readable(Protocol):
    def read(self, size: int, /) -> bytes: ...


def unpacked(data: bytes, compression: str, budget: Budget) -> bytes:
    """Unpacks a chunk or message stored with a compression "zstd", "lz4", "bz2"; "" or "none". LimitError if it unpacks
    to more than the budget allows, RecordingError for another compression; the libraries raise errors of many kinds.
    """
    match compression:
        case "" | "none":
            return data
        case "zstd":
            import zstandard

            if (size := zstandard.frame_content_size(data)) >= 0:
                budget.require_unpacked(size, "a chunk")
                return zstandard.ZstdDecompressor().decompress(data)
            return _read(zstandard.ZstdDecompressor().stream_reader(data), budget)
        case "lz4":
            import pyarrow as pa

            return _read(pa.CompressedInputStream(pa.BufferReader(data), "lz4"), budget)
        case "bz2":
            from bz2 import BZ2File

            return _read(BZ2File(BytesIO(data)), budget)
    raise RecordingError(f"{budget.path}: a chunk is compressed by {compression!r}; valid: zstd, lz4, bz2")


def _read(stream: _Readable, budget: Budget) -> bytes:
    parts: list[bytes] = []
    size = 0
    while part := stream.read(_PIECE):
        size += len(part)
        budget.require_unpacked(size, "a chunk")
        parts.append(part)
    return b"".join(parts)
