"""Files of a bag: topics and messages of one file or a folder; damaged files are read as far as possible."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple, Self, TypeVar

import numpy as np
from numpy.typing import NDArray

from stadera.boundary import said
from stadera.errors import RecordingError, require_positive
from stadera.limits import DEFAULTS, Budget, LimitError, Limits
from stadera.types import Array

if TYPE_CHECKING:
    from stadera.logs.bags.files import Container

Record = TypeVar("Record")
Part = TypeVar("Part")
Stamps = NDArray[np.int64]
EARLIEST, LATEST = -(1 << 61), 1 << 62
"""Range of a stamp [ns], up to the year 2116. Differences of such stamps do not overflow."""


@dataclass(frozen=True)
class BagSettings:
    """Limits and tolerances for reading a bag's messages as one log, chosen for robots' logs of 50 Hz to 1 kHz."""

    head: int = 2000  # messages of joints at the beginning that determine the columns
    most_ahead: int = 100_000  # messages searched for the first one of an IMU
    decoded: int = 256  # messages decoded at a time, which bounds how far topics can be out of order
    batch: int = 4096  # messages merged at a time
    # difference between two topics' clocks above which one is set from the other [s]; one second is far above any
    # latency and far below the difference of independently set clocks
    clocks_apart: float = 1.0
    # of two topics' clocks since the beginning above which it is corrected [s]: above the scatter of the delays, below
    # what affects weighing
    drift: float = 5e-3
    drift_window: float = 5.0  # over which a clock's delays are compared [s]; queues are empty at least once in it
    # difference from the recorder's clock, or run back, above which a stamp indicates a step of the clock [s]; ntpd
    # steps a clock by 0.128 s or more and slews it by less
    header_jump: float = 0.1
    patience: float = 10.0  # time for which a sample waits for the other topics [s]; bounds the memory
    # share of stamps that repeat or run back above which they are not those of a clock, and the times of recording are
    # used
    out_of_order: float = 0.1
    out_of_order_from: int = 100  # samples needed to evaluate that share
    # stamps up to this much later than the robot's counter are kept [s]: it counts in milliseconds
    counter_late: float = 2e-3
    counter_jump: float = 0.05  # difference between stamp and counter above which one of the clocks has stepped [s]
    # relative rate by which the robot's clock may run faster than the recorder's (crystals: 20 to 100 ppm)
    counter_drift: float = 1e-4
    counter_enough: int = 32  # number of stamps in a batch whose median step is the period

    def __post_init__(self) -> None:
        require_positive("setting of a bag", self, self.__dataclass_fields__)


class Message(NamedTuple):
    """One message as stored: its topic, when it was recorded [ns], and its bytes."""

    topic: str
    received: int
    data: bytes


class Decoded(NamedTuple):
    """The values (n, columns) of n successive messages of one topic, NaN where a message marks them as unknown, and the
    columns' names in the flat table; when they were recorded and measured (n,) [ns]; the frame of the IMU, without a
    leading slash, may be empty.
    """

    topic: str
    received: Stamps
    stamp: Stamps
    frame: str
    columns: tuple[str, ...]
    values: Array


class Topic(NamedTuple):
    """Message type of a topic, in ROS 2's notation, and its definition; empty if the file has none."""

    kind: str
    definition: str = ""


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
        numbered = {int(m[1]) for p in files if (m := re.search(r"_(\d+)$", p.stem))}
        missing = sorted(set(range(max(numbered, default=-1))) - numbered)
        numbers = ", ".join(map(str, missing))
        damage = [f"parts of the bag are missing: number {numbers}"] if missing else []
        return cls(path, container, files, Budget(path, limits), damage)

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

    def messages(self, topics: Collection[str]) -> Iterator[Message]:
        """Yields all messages of these topics, file after file."""
        for path in self.files:
            yield from self.container.messages(path, topics, self.damage, self.budget)


def _in_order(path: Path) -> tuple[tuple[int, str], ...]:
    return tuple((int(part), "") if part.isdigit() else (-1, part) for part in re.split(r"(\d+)", path.name))


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
        unpack: splits a record into parts: a chunk into its messages, others into themselves. After an error the next
            record is read.
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
            damage.append(f"{path}: cut off or damaged after {read_so_far(read)} ({said(error)}); read up to there")
            break
        if record is None:
            break
        read += 1
        try:
            yield from unpack(record)
        except LimitError:
            raise
        except Exception as error:
            broken, reason = broken + 1, said(error)
    if broken:
        damage.append(f"{path}: left out {broken} damaged chunk{'s' * (broken > 1)} of messages ({reason})")


def unpacked(data: bytes, compression: str, limits: Limits, what: str) -> bytes:
    """Unpacks what is stored with a compression "zstd", "lz4", "bz2"; "" or "none". LimitError if it unpacks to more
    than the limits allow, RecordingError for another compression; pyarrow raises errors of several kinds.
    """
    if compression in ("", "none"):
        return data
    if compression not in ("zstd", "lz4", "bz2"):
        raise RecordingError(f"{what} is compressed by {compression!r}; valid: zstd, lz4, bz2")
    import pyarrow as pa

    if compression == "zstd":
        import zstandard

        limits.require("unpacked", zstandard.frame_content_size(data), what, "bytes that it unpacks to")  # if stated
    stream, parts, size = pa.CompressedInputStream(pa.BufferReader(data), compression), list[bytes](), 0
    while part := stream.read(1 << 20):
        size += len(part)
        limits.require("unpacked", size, what, "bytes that it unpacks to")
        parts.append(part)
    return b"".join(parts)
