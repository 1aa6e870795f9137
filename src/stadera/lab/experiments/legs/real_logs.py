"""Where real logs are found; the project carries none."""

from __future__ import annotations

import os
from pathlib import Path

from stadera.errors import StaderaError

VARIABLE = "STADERA_DATA"
_BESIDE = Path("..") / "shared" / "data"


class MissingDataError(StaderaError):
    """Real logs that an experiment needs are not on this machine."""


def data_folder(given: Path | None = None) -> Path:
    """The folder of real logs: the given one, else what STADERA_DATA names, else ../shared/data.

    Raises:
        MissingDataError: it does not exist.
    """
    named = os.environ.get(VARIABLE)
    folder = given or (Path(named) if named else _BESIDE)
    if not folder.is_dir():
        raise MissingDataError(f"no real logs: {folder} does not exist (set {VARIABLE} to their folder)")
    return folder


def real_log(folder: Path, name: str) -> Path:
    """A log of that folder, `real/<name>`.

    Raises:
        MissingDataError: it is not there.
    """
    path = folder / "real" / name
    if not path.is_file():
        raise MissingDataError(f"{path}: no such log (set {VARIABLE} to the folder that holds real/{name})")
    return path
