"""What reading one file may take: bytes once unpacked, columns, elements, processor time.

A file of a few kilobytes can unpack to gigabytes or keep a parser busy for ever, damaged or made so. Reading stops at
these limits with an error that names the one to raise, `--limit NAME=VALUE` or `Limits(name=value)`.
"""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator, Sized
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TypeVar

from stadera.errors import StaderaError, UnknownNameError, require_positive

Item = TypeVar("Item")

_MEGABYTE = 1e6
_LOOKS = 64  # calls of `Budget.tick` for each look at the clock


class LimitError(StaderaError):
    """Reading a file takes more than it may; names the limit, and how to raise it."""


@dataclass(frozen=True)
class Limits:
    """Limits of reading one file, each far above what robots' logs and models need.

    Attributes:
        unpacked: bytes that one message, chunk, page or array may unpack to, and a whole log in memory, unless the file
            is so large that `ratio` allows more. Writers' chunks and pages have 1 to 16 MB.
        ratio: of a whole log in memory to its file. Robots' logs have 1 to 20.
        columns: of a table, or of the joints' states of a bag. A quadruped has under 100.
        elements: of a robot's model file, copies that it asks for among them. Humanoids have under 5,000.
        depth: of nesting in a model file, and of joints one behind the other.
        seconds: of processor time for reading a file, `seconds_per_megabyte` more for each megabyte of it. The slowest
            kind, messages that Python decodes, takes 0.2 s/MB on a desktop computer.
    """

    unpacked: float = 256e6
    ratio: float = 50.0
    columns: float = 10_000
    elements: float = 20_000
    depth: float = 100
    seconds: float = 10.0
    seconds_per_megabyte: float = 10.0

    def __post_init__(self) -> None:
        require_positive("limit", self, [field.name for field in fields(self)])

    @classmethod
    def parse(cls, texts: Iterable[str]) -> Limits:
        """From texts such as "seconds=600".

        Raises:
            StaderaError: not of that form, no such limit, or a value that is not a positive number.
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
        """Checks a value against the limit of that name.

        Args:
            what: what takes so much, such as "columns".

        Raises:
            LimitError: it is above.
        """
        limit: float = getattr(self, name)
        if value > limit:
            raise LimitError(
                f"{path}: {what}: {value:.6g}, and at most {limit:.6g} are read; --limit {name}={2 * value:.2g} raises "
                "that, if you trust the file"
            )


DEFAULTS = Limits()
UNLIMITED = Limits(*[float("1e300")] * len(fields(Limits)))
"""For files that were read before."""


class Budget:
    """What reading one log has taken so far, from when this is made.

    Args:
        path: of the file or folder.
        limits: what it may take.
    """

    def __init__(self, path: Path, limits: Limits = DEFAULTS) -> None:
        self.path, self.limits = path, limits
        files = path.rglob("*") if path.is_dir() else [path]
        self._size = sum(file.stat().st_size for file in files if file.is_file())
        self._allowed = limits.seconds + limits.seconds_per_megabyte * self._size / _MEGABYTE
        self._spent, self._ticks, self._held = 0.0, 0, 0.0
        self._since: float | None = time.thread_time()  # None while the clock stands

    def tick(self) -> None:
        """One more step of a loop that may be long.

        Raises:
            LimitError: too much time has passed.
        """
        self._ticks += 1
        if self._ticks % _LOOKS == 0:
            self.check_time()

    @property
    def is_over(self) -> bool:
        """Whether too much time has passed."""
        running = 0.0 if self._since is None else time.thread_time() - self._since
        return self._spent + running > self._allowed

    def check_time(self) -> None:
        """Looks at the clock. Raises as `tick`."""
        if self.is_over:
            raise LimitError(
                f"{self.path}: reading it takes more than {self._allowed:.3g} s of processor time; --limit "
                f"seconds={10 * self._allowed:.2g} raises that, if you trust the file"
            )

    def require_columns(self, names: Sized) -> None:
        """Checks how many there are. Raises LimitError: too many."""
        self.limits.require("columns", len(names), self.path, "columns")

    def require_unpacked(self, size: float, what: str) -> None:
        """Checks the bytes that a part of the file unpacks to. Raises LimitError: too many."""
        self.limits.require("unpacked", size, self.path, f"bytes that {what} unpacks to")

    @property
    def most_bytes(self) -> int:
        """That a whole log may have in memory."""
        return int(max(self.limits.unpacked, self.limits.ratio * self._size))

    @property
    def most_seconds(self) -> int:
        """Of processor time that reading may take."""
        return int(min(self._allowed, 1e9))

    def hold(self, size: float) -> None:
        """So many more bytes are kept in memory. Raises LimitError: too many for a file of this size."""
        self._held += size
        if self._held > self.most_bytes:
            self.limits.require("unpacked", self._held, self.path, "bytes of the log in memory")

    def timed(self, items: Iterable[Item]) -> Iterator[Item]:
        """The same; from now on only the time that making them takes is counted, not what happens in between."""
        self._pause()
        return self._timed(iter(items))

    def _timed(self, items: Iterator[Item]) -> Iterator[Item]:
        end = object()
        while True:
            self._since = time.thread_time()
            item = next(items, end)
            self._pause()
            self.check_time()
            if item is end:
                return
            yield item  # type: ignore[misc]

    def _pause(self) -> None:
        if self._since is not None:
            self._spent, self._since = self._spent + time.thread_time() - self._since, None
