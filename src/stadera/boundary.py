"""The boundary to other libraries and to the file system: what they raise becomes an error that names file and step.

Parsers meet damaged or hostile bytes with errors of any kind: struct.error, KeyError, UnicodeDecodeError,
OverflowError, ArrowException, RecursionError, MemoryError. A reader does what it hands to another library inside
`foreign`, so that its callers need to expect one class of errors.
"""

from __future__ import annotations

import stat
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from stadera.errors import RecordingError, StaderaError

_LONGEST = 200  # characters of another library's message


@contextmanager
def foreign(path: object, step: str, kind: type[StaderaError] = RecordingError) -> Iterator[None]:
    """Whatever is raised inside becomes an error of `kind`: "PATH: STEP: why". Errors of this package pass.

    Args:
        path: the file.
        step: what was found or being done, such as "damaged Parquet file".
    """
    try:
        yield
    except StaderaError:
        raise
    except Exception as error:
        raise kind(f"{path}: {step}: {said(error)}") from error


def said(error: Exception) -> str:
    """What an exception says, in one short line."""
    if isinstance(error, OSError) and error.strerror:
        return error.strerror
    if isinstance(error, RecursionError):
        return "nested too deeply"
    if isinstance(error, MemoryError):
        return "it takes more memory than there is"
    if isinstance(error, KeyError):
        return f"it has no {error}"
    text = " ".join("".join(c if c.isprintable() else " " for c in str(error)).split())
    return text[:_LONGEST] or type(error).__name__


def require_input(
    path: Path, kind: type[StaderaError] = RecordingError, *, folder: bool = False, hint: str = ""
) -> None:
    """Checks that something can be read there: a file, or, where that is allowed, a folder.

    A pipe, socket or device is refused: readers look at a file more than once. `hint` is added where nothing is there.

    Raises:
        StaderaError: of `kind`; nothing there, not readable, or something else than a file.
    """
    if not _is_text(str(path)):
        raise kind(f"{path}: cannot be read: its name is not UTF-8, which other libraries need; rename it")
    try:
        found = path.stat()
    except FileNotFoundError:
        raise kind(f"{path}: no such file{hint}") from None
    except (OSError, ValueError, RuntimeError) as error:  # a name too long, a loop of links, a NUL in the name
        raise kind(f"{path}: cannot be read: {said(error)}") from None
    if stat.S_ISDIR(found.st_mode):
        if folder:
            return
        raise kind(f"{path}: a folder, not a file")
    if not stat.S_ISREG(found.st_mode):
        raise kind(f"{path}: a pipe, socket or device, not a file; write what comes out of it to a file first")
    with foreign(path, "cannot be read", kind), path.open("rb"):
        pass


def _is_text(name: str) -> bool:
    try:
        name.encode()
    except UnicodeEncodeError:
        return False
    return True
