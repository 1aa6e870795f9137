"""Translation of other libraries' exceptions into StaderaError, with the file and the step that failed.

Parsers raise errors of any kind on damaged or hostile bytes: struct.error, KeyError, UnicodeDecodeError, OverflowError,
ArrowException, RecursionError, MemoryError. Readers call other libraries inside `foreign`, so that their callers need
to handle one class of errors only.
"""

import stat
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from stadera.errors import RecordingError, StaderaError


@contextmanager
def foreign(path: object, step: str, kind: type[StaderaError] = RecordingError) -> Iterator[None]:
    """Context that re-raises any exception as `kind` with the message "PATH: STEP: why", STEP the operation or the
    problem, such as "damaged Parquet file". StaderaErrors pass unchanged.
    """
    try:
        yield
    except StaderaError:
        raise
    except Exception as error:
        raise kind(f"{path}: {step}: {said(error)}") from error


def said(error: Exception) -> str:
    """Message of an exception, shortened to one line of at most 200 characters."""
    if isinstance(error, OSError) and error.strerror:
        return error.strerror
    if isinstance(error, RecursionError):
        return "nested too deeply"
    if isinstance(error, MemoryError):
        return "it takes more memory than there is"
    if isinstance(error, KeyError):
        return f"it has no {error}"
    text = " ".join("".join(c if c.isprintable() else " " for c in str(error)).split())
    return text[:200] or type(error).__name__


def require_input(
    path: Path, kind: type[StaderaError] = RecordingError, *, folder: bool = False, hint: str = ""
) -> None:
    """Checks that `path` is a readable file or, if `folder` is true, a folder, else raises `kind`. `hint` is appended
    to "no such file".

    Pipes, sockets and devices are refused, since readers open a file more than once.
    """
    try:
        str(path).encode()
    except UnicodeEncodeError:
        raise kind(f"{path}: cannot be read: its name is not UTF-8, which other libraries need; rename it") from None
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
        raise kind(f"{path}: a pipe, socket or device, not a file; write its output to a file first")
    with foreign(path, "cannot be read", kind), path.open("rb"):
        pass


def begins_with(path: Path, magic: bytes) -> bool:
    """True for a file with these first bytes."""
    if not path.is_file():
        return False
    with path.open("rb") as file:
        return file.read(len(magic)) == magic
