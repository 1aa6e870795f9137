"""Converts data frames of pandas, polars and pyarrow to recordings, and recordings to named columns.

None of these libraries is imported: a data frame is any object that provides columns by name.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from stadera.errors import RecordingError
from stadera.logs.batches import Batch
from stadera.logs.columns import IMU_FRAME, TIME, layout
from stadera.logs.reading import AS_RECORDED, Reading
from stadera.logs.recording import Recording
from stadera.logs.tables.rows import table_recordings
from stadera.logs.topics import Topics
from stadera.types import Array


def from_dataframe(
    df: Any,
    joints: Sequence[str] | None,
    require: Collection[str],
    imu_frame: str | None,
    source: str,
    reading: Reading = AS_RECORDED,
) -> Recording:
    """See `Recording.from_dataframe`."""
    names = _names(df, source)
    if TIME not in names and getattr(getattr(df, "index", None), "name", None) == TIME:
        df = df.reset_index()
        names = _names(df, source)
    found = layout(names, source, joints, require, reading, Topics())
    found = replace(found, imu_frame=imu_frame or _frame_in(df))
    columns = {name: _numbers(df[name], name, source) for name in found.recorded}
    first, samples = next((name, len(values)) for name, values in columns.items())
    if wrong := next((name for name, values in columns.items() if values.shape != (samples,)), None):
        raise RecordingError(
            f"{source}: column {wrong!r} has {len(columns[wrong])} values, {first!r} has {samples}; both need as many"
        )
    values = np.stack(tuple(columns.values()))
    return next(table_recordings([Batch(values, np.isnan(values))], found, source, None))


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


def _frame_in(df: Any) -> str | None:
    """The IMU frame in a pyarrow table's metadata."""
    metadata = getattr(getattr(df, "schema", None), "metadata", None)
    frame = metadata.get(IMU_FRAME.encode()) if metadata else None
    return None if frame is None else str(frame.decode())


def _numbers(column: Any, name: str, source: str) -> Array:
    """A column as float64; missing values are NaN."""
    values = np.asarray(column)
    if values.dtype.kind == "O":
        missing = (type(None), *({type(value) for value in values if type(value).__name__ == "NAType"}))  # pandas.NA
        values = np.array([np.nan if isinstance(value, missing) else value for value in values])
    if values.dtype.kind not in "fiub":
        seconds = "; time is needed in seconds" if name == TIME else ""
        raise RecordingError(f"{source}: column {name!r} holds {values.dtype}, not numbers{seconds}")
    return values.astype(np.float64)
