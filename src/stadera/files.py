"""Files that appear whole or not at all, several of them together or none; never on an input or a special file."""

from __future__ import annotations

import os
import secrets
import stat
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from dataclasses import dataclass, field
from os import PathLike
from pathlib import Path

from stadera.errors import StaderaError

AnyPath = str | PathLike[str]

_SPECIAL = ("/dev/", "/proc/", "/sys/")
_LONGEST_SUFFIX = 16  # characters that a draft takes over
_MOST_INPUTS = 100_000  # files looked at in folders


@dataclass
class OutputGate:
    """What a command reads, and what it has written.

    Attributes:
        inputs: device and number of every file that must not be written on, whatever path leads to it.
        written: in order, each file and whether one that was there before was replaced.
    """

    inputs: frozenset[tuple[int, int]] = frozenset()
    written: list[tuple[Path, bool]] = field(default_factory=list)
    drafts: set[Path] = field(default_factory=set)


_GATE: ContextVar[OutputGate | None] = ContextVar("output gate", default=None)


@contextmanager
def output_gate(inputs: Iterable[AnyPath]) -> Iterator[OutputGate]:
    """Within it no file is written on any of these inputs: files, or folders with all that is in them."""
    gate = OutputGate(frozenset(_identities(inputs)))
    token = _GATE.set(gate)
    try:
        yield gate
    finally:
        _GATE.reset(token)


def require_writable(path: AnyPath) -> Path:
    """Checks that a file can be written there, before the work that fills it.

    Returns:
        the path, links followed.

    Raises:
        StaderaError: the folder is not there or cannot be written to; what is there is no regular file, or an input
            of the command.
    """
    path = Path(path)
    if os.path.abspath(path).startswith(_SPECIAL) and not os.path.abspath(path).startswith("/dev/shm/"):
        raise StaderaError(f"{path}: is no place for a file; name a regular file")
    try:
        place = path.resolve()
        found = place.stat() if place.exists() else None
    except (OSError, RuntimeError, ValueError) as error:
        raise StaderaError(f"{path}: cannot be written: {getattr(error, 'strerror', None) or error}") from None
    if found is not None:
        _require_replaceable(path, found)
    if not place.parent.is_dir():
        raise StaderaError(f"{path}: no such folder {str(path.parent)!r}")
    if not os.access(place.parent, os.W_OK):
        raise StaderaError(f"{path}: the folder {str(path.parent)!r} cannot be written to")
    return place


def _require_replaceable(path: Path, found: os.stat_result) -> None:
    """What is there has to be a regular file, and no input of the command."""
    if stat.S_ISDIR(found.st_mode):
        raise StaderaError(f"{path}: is a folder, not a file to write")
    if not stat.S_ISREG(found.st_mode):
        raise StaderaError(f"{path}: is a pipe, socket or device; name a regular file")
    gate = _GATE.get()
    if gate is not None and (found.st_dev, found.st_ino) in gate.inputs:
        raise StaderaError(f"{path}: would replace an input")


@contextmanager
def written_together(paths: Sequence[AnyPath]) -> Iterator[tuple[Path, ...]]:
    """Drafts to fill, which become the files when the block ends without an error; else nothing appears.

    Each draft keeps its file's suffix, for writers that go by it. What was there before stays until the end, and so
    do its permissions. Written to disk before it takes its place, so a full disk is noticed in time.

    Raises:
        StaderaError: a path that cannot be written (see `require_writable`), or one that is named twice; a draft that
            was left empty.
    """
    targets = [require_writable(path) for path in paths]
    if twice := next((path for path, target in zip(paths, targets, strict=True) if targets.count(target) > 1), None):
        raise StaderaError(f"{twice}: named for two outputs")
    gate = _GATE.get() or OutputGate()
    names: dict[Path, AnyPath] = {}
    try:
        for path, target in zip(paths, targets, strict=True):
            names[_draft(target)] = path
        gate.drafts.update(names)
        yield tuple(names)
        _put_in_place(names, targets, gate)
    except OSError as error:
        known = {str(draft): path for draft, path in names.items()}
        where = known.get(str(error.filename), error.filename) or ", ".join(map(str, paths))
        raise StaderaError(f"{where}: cannot be written: {error.strerror or error}") from error
    finally:
        gate.drafts.difference_update(names)
        for draft in names:
            draft.unlink(missing_ok=True)


def _put_in_place(names: Mapping[Path, AnyPath], targets: Sequence[Path], gate: OutputGate) -> None:
    """Every draft is on the disk before the first takes its file's place."""
    for draft in names:
        _finish(draft)
    for (draft, path), target in zip(names.items(), targets, strict=True):
        replaced = target.exists()
        os.replace(draft, target)
        if target not in gate.drafts:
            gate.written.append((Path(path), replaced))


def write_text(path: Path, text: str) -> None:
    """Writes UTF-8. What is no character, such as bytes of a file's name, is written as JSON writes it, \\udcff."""
    path.write_text(text, encoding="utf-8", errors="backslashreplace")


def _draft(target: Path) -> Path:
    """A new empty file in the target's folder, with its permissions where it is there."""
    suffix = target.suffix if len(target.suffix) <= _LONGEST_SUFFIX else ""
    draft = target.with_name(f".{secrets.token_hex(6)}.draft{suffix}")
    os.close(os.open(draft, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o666))
    with suppress(OSError):
        draft.chmod(stat.S_IMODE(target.stat().st_mode))
    return draft


def _finish(draft: Path) -> None:
    """Everything written is on the disk.

    Raises:
        OSError: it is not, or nothing was written.
    """
    file = os.open(draft, os.O_RDONLY)
    try:
        os.fsync(file)
        if os.fstat(file).st_size == 0:
            raise OSError(0, "nothing was written", str(draft))
    finally:
        os.close(file)


def _identities(paths: Iterable[AnyPath]) -> Iterator[tuple[int, int]]:
    for given in paths:
        path = Path(given)
        with suppress(OSError, ValueError, RuntimeError):
            found = [path] if path.is_file() else path.rglob("*") if path.is_dir() else []
            for _, file in zip(range(_MOST_INPUTS), found, strict=False):
                with suppress(OSError):
                    status = file.stat()
                    yield status.st_dev, status.st_ino
