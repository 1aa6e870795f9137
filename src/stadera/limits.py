"""Limits on the resources used to read one file: unpacked bytes, columns, elements, processor time.

A file of a few kilobytes, damaged or malicious, can unpack to gigabytes or keep a parser busy indefinitely. Reading
stops at these limits with an error that names the limit and how to raise it: `--limit NAME=VALUE` or
`Limits(name=value)`.
"""

import time
from collections.abc import Iterable, Sized
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Self

from stadera.errors import StaderaError, UnknownNameError, require_positive


class LimitError(StaderaError):
    """Reading a file exceeds a limit. The message names the limit and how to raise it."""


@dataclass(frozen=True)
class Limits:
    """Limits for reading one file, each far above what logs and models of robots need."""

    # bytes that one message, chunk, page or array may unpack to, and that a whole log may take in memory unless `ratio`
    # allows more. Writers' chunks and pages have 1 to 16 MB.
    unpacked: float = 256e6
    ratio: float = 50.0  # of a whole log in memory to its file size. Typical logs have 1 to 20.
    columns: float = 10_000  # of a table, or joints in the state messages of a bag. A quadruped has under 100.
    elements: float = 20_000  # of a robot's model file, including the copies it asks for. Humanoids have under 5,000.
    depth: float = 100  # of nested elements in a model file, and of the chain of joints
    # of processor time for one file, plus `seconds_per_megabyte` for each megabyte. The slowest kind, messages decoded
    # in Python, takes 0.2 s/MB on a desktop computer.
    seconds: float = 10.0
    seconds_per_megabyte: float = 10.0

    def __post_init__(self) -> None:
        require_positive("limit", self, [field.name for field in fields(self)])

    @classmethod
    def parse(cls, texts: Iterable[str]) -> Self:
        """Parses texts such as "seconds=600". Raises StaderaError: wrong format, unknown limit, or a value that is not
        a positive number.
        """
        changed: dict[str, float] = {}
        for text in texts:
            name, _, value = text.partition("=")
            if name not in (valid := tuple(field.name for field in fields(cls))):
                raise UnknownNameError("limit", name, valid, f"--limit {text}")
            try:
                changed[name] = float(value)
            except ValueError:
                raise StaderaError(f"--limit {text}: {value!r} is not a number") from None
        return cls(**changed)

    def require(self, name: str, value: float, path: object, what: str) -> None:
        """Checks a value against the named limit; `what` is the quantity, for the message. Raises LimitError: it
        exceeds the limit.
        """
        limit: float = getattr(self, name)
        if value > limit:
            raise LimitError(
                f"{path}: {what}: {value:.6g}, and at most {limit:.6g} are read; --limit {name}={2 * value:.2g} raises "
                "that, if you trust the file"
            )


DEFAULTS = Limits()
UNLIMITED = Limits(*[float("1e300")] * len(fields(Limits)))
"""For files that have been read before."""


class Budget:
    """Resources used so far to read one log, counted from construction."""

    def __init__(self, path: Path, limits: Limits = DEFAULTS) -> None:
        self.path, self.limits = path, limits
        files = path.rglob("*") if path.is_dir() else [path]
        self._size = sum(file.stat().st_size for file in files if file.is_file())
        self._allowed = limits.seconds + limits.seconds_per_megabyte * self._size / 1e6
        self._ticks, self._held = 0, 0.0
        self._begun = self._paused = time.thread_time()  # begun: later by the time that was not spent on reading

    def tick(self) -> None:
        """Counts one step of a loop that may be long, and checks the time at every 64th. Raises LimitError: it is
        exceeded.
        """
        self._ticks += 1
        if self._ticks % 64 == 0:
            self.check_time()

    @property
    def is_over(self) -> bool:
        """Whether the time limit is exceeded."""
        return time.thread_time() - self._begun > self._allowed

    def check_time(self) -> None:
        """Checks the time now. Raises as `tick`."""
        if self.is_over:
            raise LimitError(
                f"{self.path}: reading it takes more than {self._allowed:.3g} s of processor time; --limit "
                f"seconds={10 * self._allowed:.2g} raises that, if you trust the file"
            )

    def require_columns(self, names: Sized) -> None:
        """Checks the number of columns. Raises LimitError if there are too many."""
        self.limits.require("columns", len(names), self.path, "columns")

    def require_unpacked(self, size: float, what: str) -> None:
        """Checks the bytes that a part of the file unpacks to. Raises LimitError if there are too many."""
        self.limits.require("unpacked", size, self.path, f"bytes that {what} unpacks to")

    @property
    def most_bytes(self) -> int:
        """Bytes that the whole log may take in memory."""
        return int(max(self.limits.unpacked, self.limits.ratio * self._size))

    @property
    def most_seconds(self) -> int:
        """Processor time allowed for reading [s]."""
        return int(min(self._allowed, 1e9))

    def hold(self, size: float) -> None:
        """Counts bytes kept in memory. Raises LimitError if there are too many for a file of this size."""
        self._held += size
        if self._held > self.most_bytes:
            self.limits.require("unpacked", self._held, self.path, "bytes of the log in memory")

    def pause(self) -> None:
        """Begins a time that is the consumer's and does not count."""
        self._paused = time.thread_time()

    def resume(self) -> None:
        """Ends it."""
        self._begun += time.thread_time() - self._paused
