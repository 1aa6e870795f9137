"""Opening a log of any known kind. A new kind is one file with a reader and one line in READERS."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from os import PathLike
from pathlib import Path
from typing import Protocol

from stadera.errors import RecordingError
from stadera.recording import mcap_file, sqlite_file
from stadera.recording.bag_log import BagLog
from stadera.recording.csv_table import CsvTable
from stadera.recording.join import concatenate
from stadera.recording.parquet_table import ParquetTable
from stadera.recording.recording import Recording
from stadera.recording.topics import LogFile, Topics

CHUNK_ROWS = 65536


class Reader(Protocol):
    """What a kind of log must offer."""

    @property
    def name(self) -> str:
        """What it reads, for messages."""
        ...

    @property
    def suffixes(self) -> tuple[str, ...]:
        """File name endings, lower case, that promise this kind; may be none."""
        ...

    def accepts(self, path: Path) -> bool:
        """Whether the content at `path` (not its name) is of this kind; looks at the beginning only."""
        ...

    def stream(
        self, path: Path, *, joints: Sequence[str] | None, require: Collection[str], rows: int | None, topics: Topics
    ) -> Iterator[Recording]:
        """As the module's `stream`; `rows` None: all in one. A kind without topics refuses any asked for."""
        ...


# The first that accepts reads: those with magic bytes stand before those that take any text.
READERS: tuple[Reader, ...] = (
    ParquetTable(),
    BagLog("MCAP bag", ".mcap", mcap_file.MAGIC, mcap_file.McapStorage()),
    BagLog("sqlite3 bag", ".db3", sqlite_file.MAGIC, sqlite_file.SqliteStorage()),
    CsvTable(),
)


def stream(
    path: str | PathLike[str],
    *,
    joints: Sequence[str] | None = None,
    require: Collection[str] = (),
    rows: int = CHUNK_ROWS,
) -> Iterator[Recording]:
    """A log as consecutive recordings of `rows` samples each, memory flat in the log's length.

    Args:
        path: the log; a LogFile chooses among the topics of a bag.
        joints: the joints to read, in this order; None for all.
        require: what each of these joints must have: velocity, acceleration, effort; and "imu".
        rows: samples a chunk; the last one is shorter.

    Raises:
        RecordingError: at once where the file is not there, of no known kind or lacks a column; on iterating where a
            value is not a finite number or time does not increase. Names the file, the column and the sample.
    """
    if rows < 1:
        raise RecordingError(f"a chunk needs at least one row, got {rows}")
    log = LogFile.of(path)
    return reader_of(log.path).stream(log.path, joints=joints, require=require, rows=rows, topics=log.topics)


def read(path: str | PathLike[str], *, joints: Sequence[str] | None = None, require: Collection[str] = ()) -> Recording:
    """A whole log as one recording. Arguments and errors as `stream`."""
    log = LogFile.of(path)
    reader = reader_of(log.path)
    return concatenate(tuple(reader.stream(log.path, joints=joints, require=require, rows=None, topics=log.topics)))


def reader_of(path: Path) -> Reader:
    """The reader for what is at `path`, by content.

    Raises:
        RecordingError: nothing there, nothing in it, of no known kind, or of another kind than its name says.
    """
    known = ", ".join(f"{reader.name} ({', '.join(reader.suffixes)})" for reader in READERS)
    if not path.exists():
        raise RecordingError(f"{path}: no such file")
    if path.is_file() and path.stat().st_size == 0:
        raise RecordingError(f"{path}: the file is empty; accepted: {known}")
    try:
        found = next((reader for reader in READERS if reader.accepts(path)), None)
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read: {error.strerror}") from None
    named = next((reader for reader in READERS if path.suffix.lower() in reader.suffixes), None)
    if found is None:
        what = f"not what its name says, no {named.name}" if named else "no log"
        what = "a directory, not a log" if path.is_dir() else f"{what} that can be read"
        raise RecordingError(f"{path}: {what}; accepted: {known}")
    if named is not None and named is not found:
        raise RecordingError(f"{path}: not what its name says: content is {found.name}; accepted: {known}")
    return found
