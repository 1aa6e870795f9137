"""Locates real logs: in a given folder, STADERA_DATA, ../shared/data, or else in the package."""

from __future__ import annotations

import os
from pathlib import Path

from stadera.errors import StaderaError
from stadera.logs.topics import example

VARIABLE = "STADERA_DATA"
_BESIDE = Path("..") / "shared" / "data"


class MissingDataError(StaderaError):
    """Real logs needed by an experiment are not available."""


def data_folder(given: Path | None = None) -> Path | None:
    """The folder of real logs: the given one, else STADERA_DATA, else ../shared/data; None if there is none."""
    named = os.environ.get(VARIABLE)
    folder = given or (Path(named) if named else None)
    if folder is None:
        return _BESIDE if _BESIDE.is_dir() else None
    if not folder.is_dir():
        raise MissingDataError(f"no real logs: {folder} does not exist (set {VARIABLE} to their folder)")
    return folder


def real_log(name: str, given: Path | None = None) -> Path:
    """Path of a log, `real/<name>.csv` in the folder of real logs, or the package's own if there is no folder."""
    folder = data_folder(given)
    path = example(name) if folder is None else folder / "real" / f"{name}.csv"
    if not path.is_file():
        raise MissingDataError(f"{path}: no such log (set {VARIABLE} to the folder that holds real/{name}.csv)")
    return path
