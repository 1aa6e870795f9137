"""Writes recordings as the flat table; a file is written completely or not at all."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import chain
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from stadera.errors import RecordingError
from stadera.files import written_together
from stadera.logs.batches import MOST_ROWS
from stadera.logs.columns import IMU_FRAME
from stadera.logs.frames import columns_of
from stadera.logs.recording import Recording

if TYPE_CHECKING:
    import pyarrow as pa

SUFFIXES: tuple[str, ...] = (".csv", ".parquet", ".pq")


def write_table(recording: Recording | Iterable[Recording], path: str | PathLike[str]) -> Path:
    """Writes a recording, or consecutive chunks of one, as a flat table, CSV or Parquet according to the suffix.

    Values are preserved bit for bit. The name of the IMU frame is stored in the metadata of Parquet, and lost in CSV.
    The file is written completely or not at all; an existing file stays until then.

    Raises:
        RecordingError: another suffix, no recording, or chunks with different columns.
        StaderaError: the folder does not exist or is not writable.
    """
    path = Path(path)
    if path.suffix.lower() not in SUFFIXES:
        raise RecordingError(f"{path}: a table is written as one of {', '.join(SUFFIXES)}")
    with written_together([path]) as (draft,):
        _write(iter([recording] if isinstance(recording, Recording) else recording), draft, path)
    return path


def _write(chunks: Iterator[Recording], draft: Path, path: Path) -> None:
    from pyarrow import csv as pacsv
    from pyarrow import parquet

    first = next(chunks, None)
    if first is None:
        raise RecordingError(f"{path}: nothing to write")
    head = to_arrow(first)
    if unfit := next((name for name in head.column_names if any(sign in name for sign in ',"\n\r')), None):
        raise RecordingError(f"{path}: column {unfit!r} has a comma, quote or line break in its name")
    if path.suffix.lower() == ".csv":
        writer = pacsv.CSVWriter(draft, head.schema, write_options=pacsv.WriteOptions(quoting_header="none"))
    else:
        writer = parquet.ParquetWriter(draft, head.schema, use_dictionary=False)
    with writer:
        for table in chain([head], map(to_arrow, chunks)):
            if table.schema != head.schema:
                raise RecordingError(f"{path}: chunks differ in their columns")
            for batch in table.to_batches(MOST_ROWS):
                writer.write_batch(batch)


def to_arrow(recording: Recording) -> pa.Table:
    """The flat table of a recording, all columns float64."""
    import pyarrow as pa

    columns = columns_of(recording)
    table = pa.table({name: pa.array(np.ascontiguousarray(values)) for name, values in columns.items()})
    frame = recording.imu.frame if recording.imu is not None else None
    return table if frame is None else table.replace_schema_metadata({IMU_FRAME: frame})
