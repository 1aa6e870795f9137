"""Journal of finished logs, one JSON line each, from which an interrupted run resumes."""

import json
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import stadera
from stadera.boundary import foreign
from stadera.errors import StaderaError

Entry = Mapping[str, Any]
"""Plain values."""


def read_journal(path: Path) -> Iterator[Entry]:
    """Entries written by this version of the package; incomplete lines are skipped, and a missing file has no
    entries.
    """
    if not path.exists():
        return
    with path.open(encoding="utf-8") as lines:
        for line in lines:
            try:
                entry = json.loads(line)
            except ValueError:
                continue  # incomplete: the run was interrupted while writing it
            if isinstance(entry, dict) and entry.get("version") == stadera.__version__:
                yield entry


@contextmanager
def journal(path: Path) -> Iterator[Callable[[Entry], None]]:
    """Yields a function that appends entries immediately. Creates the folder if necessary. Raises StaderaError: it
    cannot be written.
    """
    with foreign(path, "outcomes cannot be kept there", StaderaError):
        path.parent.mkdir(parents=True, exist_ok=True)
        file = path.open("a", encoding="utf-8")
    with file:
        file.write("\n")  # ends an incomplete line

        def append(entry: Entry) -> None:
            file.write(json.dumps({"version": stadera.__version__, **entry}, ensure_ascii=False) + "\n")
            file.flush()

        yield append
