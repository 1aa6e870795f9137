"""What is done, a line of JSON each, appended as it comes in: what a run goes on from if it was broken off."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import stadera
from stadera.errors import StaderaError

Entry = Mapping[str, Any]
"""Plain values."""


def read_journal(path: Path) -> Iterator[Entry]:
    """The entries that this version of the package wrote; an incomplete line is skipped, no file is no entry."""
    if not path.exists():
        return
    with path.open(encoding="utf-8") as lines:
        for line in lines:
            try:
                entry = json.loads(line)
            except ValueError:
                continue  # incomplete: the run was broken off while it was written
            if isinstance(entry, dict) and entry.get("version") == stadera.__version__:
                yield entry


@contextmanager
def journal(path: Path) -> Iterator[Callable[[Entry], None]]:
    """Appends entries, each at once; its folder is made.

    Raises:
        StaderaError: it cannot be written.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        file = path.open("a", encoding="utf-8")
    except OSError as error:
        raise StaderaError(f"{path}: outcomes cannot be kept there: {error.strerror}") from None
    with file:
        file.write("\n")  # ends an incomplete line

        def append(entry: Entry) -> None:
            file.write(json.dumps({"version": stadera.__version__, **entry}, ensure_ascii=False) + "\n")
            file.flush()

        yield append
