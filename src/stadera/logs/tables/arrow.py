"""Converts Arrow's record batches to batches of numbers, for CSV and Parquet. Arrow is imported lazily."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from stadera.errors import RecordingError
from stadera.logs.batches import Batch

if TYPE_CHECKING:
    import pyarrow as pa


def batch_of(table: pa.RecordBatch, columns: Sequence[str], source: str) -> Batch:
    """Selects these columns of a record batch. A null is a blank cell. Raises RecordingError: a column is not numeric.
    Integers are rounded to the nearest double.
    """
    values = np.empty((len(columns), table.num_rows))
    blank = np.zeros(values.shape, dtype=bool) if any(table.column(name).null_count for name in columns) else None
    for i, name in enumerate(columns):
        cells = _numbers(table.column(name), name, source)
        valid, numbers = cells.buffers()  # `to_numpy` would import pandas
        if not len(cells) or numbers is None:
            continue
        values[i] = np.frombuffer(numbers, np.float64, len(cells), 8 * cells.offset)
        if blank is not None and cells.null_count:
            bits = np.unpackbits(np.frombuffer(valid, np.uint8), count=cells.offset + len(cells), bitorder="little")
            blank[i] = bits[cells.offset :] == 0
            values[i, blank[i]] = np.nan
    return Batch(values, blank)


def _numbers(column: pa.Array, name: str, source: str) -> pa.Array:
    import pyarrow as pa

    kind = column.type
    if pa.types.is_float64(kind):
        return column
    numeric = (pa.types.is_integer, pa.types.is_floating, pa.types.is_boolean, pa.types.is_decimal, pa.types.is_null)
    if not any(test(kind) for test in numeric):
        raise RecordingError(f"{source}: column {name!r} holds {kind}, not numbers")
    if pa.types.is_boolean(kind):
        column = column.cast(pa.int8())
    return column.cast(pa.float64(), safe=False)
