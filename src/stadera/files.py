"""Files that appear whole or not at all, several of them together or none."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from os import PathLike
from pathlib import Path

from stadera.errors import StaderaError

AnyPath = str | PathLike[str]


def require_writable(path: AnyPath) -> Path:
    """Checks that a file can be written there, before the work that fills it.

    Raises:
        StaderaError: the folder is not there or cannot be written to, or the path is itself a folder.
    """
    path = Path(path)
    if path.is_dir():
        raise StaderaError(f"{path}: is a folder, not a file to write")
    if not path.parent.is_dir():
        raise StaderaError(f"{path}: no such folder {str(path.parent)!r}")
    if not os.access(path.parent, os.W_OK):
        raise StaderaError(f"{path}: the folder {str(path.parent)!r} cannot be written to")
    return path


@contextmanager
def written_together(paths: Sequence[AnyPath]) -> Iterator[tuple[Path, ...]]:
    """Drafts to fill, which become the files when the block ends without an error; else nothing appears.

    Each draft keeps its file's suffix, for writers that go by it. What was there before stays until the end.

    Raises:
        StaderaError: a path that cannot be written (see `require_writable`), or one that is named twice.
    """
    targets = [require_writable(path) for path in paths]
    resolved = [target.resolve() for target in targets]
    if twice := next((target for target in targets if resolved.count(target.resolve()) > 1), None):
        raise StaderaError(f"{twice}: named for two outputs")
    drafts = tuple(target.with_name(f".{target.stem}.{os.getpid()}.draft{target.suffix}") for target in targets)
    try:
        yield drafts
        for draft, target in zip(drafts, targets, strict=True):
            os.replace(draft, target)
    except OSError as error:
        names = dict(zip(map(str, drafts), targets, strict=True))
        where = names.get(str(error.filename), error.filename) or ", ".join(map(str, targets))
        raise StaderaError(f"{where}: cannot be written: {error.strerror or error}") from error
    finally:
        for draft in drafts:
            draft.unlink(missing_ok=True)
