"""Atomic writing of output files: a command's files all appear complete, or none does. Inputs are never overwritten."""

import os
import secrets
import stat
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from dataclasses import dataclass, field
from os import PathLike
from pathlib import Path
from typing import Any

from stadera.errors import StaderaError

AnyPath = str | PathLike[str]

_SPECIAL = ("/dev/", "/proc/", "/sys/")


@dataclass
class OutputGate:
    """Inputs of a command, by device and inode number whatever path leads to them, and the files it has written so far,
    each with a flag that is True if it replaced an existing file.
    """

    inputs: frozenset[tuple[int, int]] = frozenset()
    written: list[tuple[Path, bool]] = field(default_factory=list)
    drafts: set[Path] = field(default_factory=set)


_GATE: ContextVar[OutputGate | None] = ContextVar("output gate", default=None)


@contextmanager
def output_gate(inputs: Iterable[AnyPath]) -> Iterator[OutputGate]:
    """Context in which writing to any of these inputs raises. A folder stands for all files in it."""
    gate = OutputGate(frozenset(_identities(inputs)))
    token = _GATE.set(gate)
    try:
        yield gate
    finally:
        _GATE.reset(token)


def require_writable(path: AnyPath) -> Path:
    """Checks that a file can be written to `path`, and returns it with symbolic links resolved. Call it before the
    computation that produces the content. StaderaError if the folder does not exist or is not writable, or the path
    exists and is not a regular file, or is an input of the command.
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
    """Raises unless the existing path is a regular file and not an input of the command."""
    if stat.S_ISDIR(found.st_mode):
        raise StaderaError(f"{path}: is a folder, not a file to write")
    if not stat.S_ISREG(found.st_mode):
        raise StaderaError(f"{path}: is a pipe, socket or device; name a regular file")
    gate = _GATE.get()
    if gate is not None and (found.st_dev, found.st_ino) in gate.inputs:
        raise StaderaError(f"{path}: would replace an input")


@contextmanager
def written_together(paths: Sequence[AnyPath]) -> Iterator[tuple[Path, ...]]:
    """Context that yields draft files, which replace the targets when the block ends without an error. StaderaError for
    a path that cannot be written (see `require_writable`), one given twice, or a draft left empty.

    After an error no target is created or changed. Each draft keeps its target's suffix, for writers that choose the
    format by it, and its permissions. Drafts are flushed to disk before the first target is replaced, so a full disk
    leaves the old files intact.
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
    """Flushes every draft to disk, then renames them to their targets."""
    for draft in names:
        _finish(draft)
    for (draft, path), target in zip(names.items(), targets, strict=True):
        replaced = target.exists()
        os.replace(draft, target)
        if target not in gate.drafts:
            gate.written.append((Path(path), replaced))


def write_text(path: Path, text: str) -> None:
    """Writes UTF-8. Bytes that are not valid characters, as in some file names, are escaped as in JSON (\\udcff)."""
    path.write_text(text, encoding="utf-8", errors="backslashreplace")


def save_text(path: AnyPath, text: str) -> None:
    """Writes one text completely or not at all. Raises as `written_together`."""
    with written_together([path]) as (draft,):
        write_text(draft, text)


def filled(template: Path, **values: Any) -> str:
    """The text of a jinja2 template, lines of which that hold a block alone are dropped."""
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    environment = Environment(
        loader=FileSystemLoader(template.parent),
        undefined=StrictUndefined,
        keep_trailing_newline=True,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template(template.name).render(values)


def _draft(target: Path) -> Path:
    """Creates an empty file in the target's folder, with the permissions of an existing target."""
    suffix = target.suffix if len(target.suffix) <= 16 else ""
    draft = target.with_name(f".{secrets.token_hex(6)}.draft{suffix}")
    os.close(os.open(draft, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o666))
    with suppress(OSError):
        draft.chmod(stat.S_IMODE(target.stat().st_mode))
    return draft


def _finish(draft: Path) -> None:
    """Flushes a draft to disk. Raises OSError: flushing failed, or the draft is empty."""
    file = os.open(draft, os.O_RDONLY)
    try:
        os.fsync(file)
        if os.fstat(file).st_size == 0:
            raise OSError(0, "nothing was written", str(draft))
    finally:
        os.close(file)


def _identities(paths: Iterable[AnyPath], most: int = 100_000) -> Iterator[tuple[int, int]]:
    """Device and inode number of files, or of at most so many in a folder."""
    for given in paths:
        path = Path(given)
        with suppress(OSError, ValueError, RuntimeError):
            found = [path] if path.is_file() else path.rglob("*") if path.is_dir() else []
            for _, file in zip(range(most), found, strict=False):
                with suppress(OSError):
                    status = file.stat()
                    yield status.st_dev, status.st_ino
