"""Bags: messages of topics in one file or a folder of files, whatever stores them."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple, Protocol

from stadera.errors import RecordingError


class Message(NamedTuple):
    """One message as it was stored.

    Attributes:
        topic: its name.
        received: when it was recorded [ns].
        data: in CDR.
    """

    topic: str
    received: int
    data: bytes


class Storage(Protocol):
    """One file of a bag, as its format has it."""

    def topics(self, path: Path) -> dict[str, str]:
        """Type by topic, of those in CDR.

        Raises:
            RecordingError: nothing of the file can be read.
        """
        ...

    def messages(self, path: Path, topics: Collection[str], damage: list[str]) -> Iterator[Message]:
        """Messages of these topics as recorded. What cannot be read ends or thins them, and is told to `damage`."""
        ...


@dataclass
class Bag:
    """The files of a bag, in order.

    Attributes:
        source: the bag, for messages.
        files: its files.
        storage: of their format.
        damage: what could not be read, one sentence each; grows while messages are read.
    """

    source: str
    files: tuple[Path, ...]
    storage: Storage
    damage: list[str] = field(default_factory=list)

    def topics(self) -> dict[str, str]:
        """Type by topic; ROS 1's way to write types is brought to ROS 2's.

        Raises:
            RecordingError: no file can be read.
        """
        found: dict[str, str] = {}
        readable = []
        errors = []
        for path in self.files:
            try:
                found |= self.storage.topics(path)
                readable.append(path)
            except RecordingError as error:
                errors.append(error)
        if not readable:
            raise errors[0]
        self.files = tuple(readable)
        self.damage += [str(error) for error in errors]
        return found

    def messages(self, topics: Collection[str]) -> Iterator[Message]:
        """All messages of these topics, file after file."""
        for path in self.files:
            yield from self.storage.messages(path, topics, self.damage)


def bag_files(path: Path, suffix: str) -> tuple[Path, ...]:
    """The files of a bag: itself, or a folder's in the order of the numbers in their names.

    Raises:
        RecordingError: a file of the folder is compressed as a whole.
    """
    if not path.is_dir():
        return (path,)
    if packed := next(
        (p for p in sorted(path.iterdir()) if p.name.endswith((f"{suffix}.zstd", f"{suffix}.zst"))), None
    ):
        raise RecordingError(f"{packed}: compressed as a whole; unpack it first: zstd -d {packed.name}")
    return tuple(sorted((p for p in path.iterdir() if p.suffix == suffix), key=_in_order))


def holds(path: Path, suffix: str) -> bool:
    """Whether a folder has files with this ending."""
    return path.is_dir() and any(p.suffix == suffix or f"{suffix}.zst" in p.name for p in path.iterdir())


def missing_parts(files: Collection[Path]) -> str:
    """A sentence on numbers left out in a bag's file names; empty where there are none."""
    numbered = [int(m.group(1)) for p in files if (m := re.search(r"_(\d+)$", p.stem))]
    left_out = sorted(set(range(max(numbered, default=-1) + 1)) - set(numbered))
    return f"parts of the bag are missing: number {', '.join(map(str, left_out))}" if left_out else ""


def _in_order(path: Path) -> tuple[tuple[int, str], ...]:
    return tuple((int(part), "") if part.isdigit() else (-1, part) for part in re.split(r"(\d+)", path.name))
