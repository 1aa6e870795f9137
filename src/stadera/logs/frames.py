"""Recordings as named columns: from data frames of pandas, polars and pyarrow, to tables of Arrow, CSV and Parquet.

No data frame library is imported: a data frame is any object that provides columns by name.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import chain
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from stadera.errors import RecordingError
from stadera.files import written_together
from stadera.logs.batches import MOST_ROWS, table_recordings
from stadera.logs.columns import IMU_FRAME, TIME, layout
from stadera.logs.recording import Recording, no_numbers
from stadera.logs.topics import AS_RECORDED, ReadOptions, Topics
from stadera.types import Array

if TYPE_CHECKING:
    import pyarrow as pa


def from_dataframe(
    df: Any,
    joints: Sequence[str] | None,
    require: Collection[str],
    imu_frame: str | None,
    source: str,
    reading: ReadOptions = AS_RECORDED,
) -> Recording:
    """See `Recording.from_dataframe`."""
    if callable(collect := getattr(type(df), "collect", None)):
        df = collect(df)  # a LazyFrame of polars
    names = _names(df, source)
    if TIME not in names and getattr(getattr(df, "index", None), "name", None) == TIME:
        df = df.reset_index()
        names = _names(df, source)
    found = layout(names, source, joints, require, reading, Topics())
    of_arrow = getattr(getattr(df, "schema", None), "metadata", None) or {}
    found = replace(found, imu_frame=imu_frame or of_arrow.get(IMU_FRAME.encode(), b"").decode() or None)
    columns = {name: _numbers(df[name], name, source) for name in found.recorded}
    first, samples = next((name, len(values)) for name, values in columns.items())
    if wrong := next((name for name, values in columns.items() if values.shape != (samples,)), None):
        raise RecordingError(
            f"{source}: column {wrong!r} has {len(columns[wrong])} values, {first!r} has {samples}; both need as many"
        )
    return next(table_recordings([np.stack(tuple(columns.values()))], found, source, None))


def columns_of(recording: Recording) -> dict[str, Array]:
    """Columns of a recording by their flat-table names, each (samples,)."""
    found: dict[str, Array] = {}
    for name, values in replace(recording, others=None).arrays().items():
        table = values.astype(np.float64, copy=False).reshape(len(recording), -1)
        found |= zip(recording.columns(name), table.T, strict=True)
    return found


def _names(df: Any, source: str) -> tuple[str, ...]:
    """A pyarrow table has `column_names`, pandas and polars have `columns`; a mapping has its keys."""
    names = list(df) if isinstance(df, Mapping) else getattr(df, "column_names", getattr(df, "columns", None))
    if names is None:
        raise RecordingError(
            f"{source}: {type(df).__name__} is not a data frame; valid: a pandas or polars DataFrame, a pyarrow Table, "
            "a mapping of column names to arrays"
        )
    return tuple(map(str, names))


def _numbers(column: Any, name: str, source: str) -> Array:
    """A column as float64; missing values are NaN."""
    values = np.asarray(column)
    if values.dtype.kind == "O":
        missing = (type(None), *({type(value) for value in values if type(value).__name__ == "NAType"}))  # pandas.NA
        values = np.array([np.nan if isinstance(value, missing) else value for value in values])
    if values.dtype.kind not in "fiub":
        raise RecordingError(f"{source}: column {name!r} {no_numbers(values, name)}")
    return values.astype(np.float64)


SUFFIXES: tuple[str, ...] = (".csv", ".parquet", ".pq")


def write_table(recording: Recording | Iterable[Recording], path: str | PathLike[str]) -> Path:
    """Writes a recording, or consecutive chunks of one, as a flat table, CSV or Parquet according to the suffix.

    Values are preserved bit for bit. The name of the IMU frame is stored in the metadata of Parquet, and lost in CSV.
    The file is written completely or not at all; an existing file stays until then.

    Raises:
        RecordingError: another suffix, no recording, or chunks with different columns.
        StaderaError: the folder does not exist or is not writable.
    """
    _write(map(to_arrow, [recording] if isinstance(recording, Recording) else recording), Path(path))
    return Path(path)


def write_columns(columns: Mapping[str, Array], path: str | PathLike[str]) -> None:
    """Writes columns (n,) by name as a table; errors as `write_table`."""
    import pyarrow as pa

    _write(iter([pa.table(dict(columns))]), Path(path))


def _write(tables: Iterator[pa.Table], path: Path) -> None:
    from pyarrow import csv as pacsv
    from pyarrow import parquet

    if path.suffix.lower() not in SUFFIXES:
        raise RecordingError(f"{path}: a table is written as one of {', '.join(SUFFIXES)}")
    with written_together([path]) as (draft,):
        head = next(tables, None)
        if head is None:
            raise RecordingError(f"{path}: nothing to write")
        if unfit := next((name for name in head.column_names if any(sign in name for sign in ',"\n\r')), None):
            raise RecordingError(f"{path}: column {unfit!r} has a comma, quote or line break in its name")
        if path.suffix.lower() == ".csv":
            writer = pacsv.CSVWriter(draft, head.schema, write_options=pacsv.WriteOptions(quoting_header="none"))
        else:
            writer = parquet.ParquetWriter(draft, head.schema, use_dictionary=False)
        with writer:
            for table in chain([head], tables):
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
