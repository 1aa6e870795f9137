"""The flat table read by Arrow: CSV, plain or compressed by gzip, bzip2 or zstd, and Parquet."""

from __future__ import annotations

import csv
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from stadera.boundary import begins_with, foreign
from stadera.errors import RecordingError
from stadera.limits import Budget
from stadera.logs.batches import MOST_ROWS, rows_at_once
from stadera.logs.columns import IMU_FRAME
from stadera.logs.tables import OpenTable, TableReader
from stadera.types import Array

if TYPE_CHECKING:
    import pyarrow as pa

_BLOCK_BYTES = 1 << 20  # of a CSV table, read at a time
_UNREADABLE = "not a readable CSV table"
_DAMAGED = "damaged Parquet file"
_PACKED = {b"\x1f\x8b": "gzip", b"BZh": "bz2", b"\x28\xb5\x2f\xfd": "zstd"}


@dataclass(frozen=True)
class Dialect:
    """Format of a table: names of columns, lines before the first sample, separator of columns, sign of decimals."""

    header: tuple[str, ...]
    skip: int
    separator: str = ","
    decimal: str = "."


def _is_text(path: Path) -> bool:
    """True for a file whose beginning, unpacked, is UTF-8 text."""
    if not path.is_file():
        return False
    head = _head(path, 4096)
    try:
        head[: head.rfind(b"\n") + 1 or None].decode("utf-8")
    except UnicodeDecodeError:
        return False
    return bool(head) and b"\0" not in head


def _opened_csv(budget: Budget) -> OpenTable:
    dialect = _dialect(budget.path)
    return OpenTable(dialect.header, lambda columns, rows: _batches(budget.path, dialect, columns))


def _head(path: Path, size: int) -> bytes:
    """The first bytes of a file, unpacked; empty if they cannot be read."""
    import pyarrow as pa

    with path.open("rb") as file:
        packed = _packed(file.read(4))
    if packed is None:
        with path.open("rb") as file:
            return file.read(size)
    found = bytearray()
    try:
        with pa.input_stream(str(path), compression=packed) as unpacked:
            while len(found) < size and (some := unpacked.read(4096)):
                found += some
    except (pa.ArrowException, OSError):  # damaged or cut off: the part before it is still the beginning
        pass
    return bytes(found[:size])


def _packed(head: bytes) -> str | None:
    return next((name for magic, name in _PACKED.items() if head.startswith(magic)), None)


def _dialect(path: Path) -> Dialect:
    """Determines the format. Comment lines (#) before the header are skipped; tables with ; may use decimal commas."""
    lines = _head(path, _BLOCK_BYTES).decode("utf-8-sig", errors="ignore").splitlines()
    skip = next((k for k, line in enumerate(lines) if line.strip() and not line.startswith("#")), 0)
    first, second = [*lines[skip : skip + 2], "", ""][:2]
    separator = next((sign for sign in ";\t|" if sign in first and "," not in first), ",")
    decimal = "," if separator == ";" and re.search(r"\d,\d", second) else "."
    with foreign(path, _UNREADABLE):
        header = next(csv.reader([first], delimiter=separator, skipinitialspace=True), [])
    return Dialect(tuple(name.strip() for name in header), skip + 1, separator, decimal)


def _batches(path: Path, dialect: Dialect, columns: tuple[str, ...]) -> Iterator[Array]:
    import pyarrow as pa
    from pyarrow import csv as pacsv

    # with one thread Arrow names the row of a bad cell
    reading = pacsv.ReadOptions(
        use_threads=False, block_size=_BLOCK_BYTES, column_names=dialect.header, skip_rows=dialect.skip
    )
    converting = pacsv.ConvertOptions(
        include_columns=list(columns),
        column_types=dict.fromkeys(columns, pa.float64()),
        decimal_point=dialect.decimal,
        null_values=[""],
        strings_can_be_null=True,
    )
    parsing = pacsv.ParseOptions(delimiter=dialect.separator)
    with foreign(path, _UNREADABLE), path.open("rb") as file:
        packed = _packed(file.read(4))
        try:
            with (
                pa.input_stream(str(path), compression=packed) as unpacked,
                pacsv.open_csv(unpacked, reading, parsing, converting) as reader,
            ):
                yield from _batches_of(reader, columns, str(path))
        except pa.ArrowInvalid as error:
            raise _explained(str(error), path, dialect) from None


def _explained(text: str, path: Path, dialect: Dialect) -> RecordingError:
    """Rewrites Arrow's message in terms of the log: column by name, row as a sample."""
    before = dialect.skip + 1
    if cell := re.search(r"column #(\d+): (?:Row #(\d+): )?.*invalid value '(.*)'", text, re.S):
        column, row, value = cell.groups()
        sample = f" at sample {int(row) - before}" if row else ""
        name = dialect.header[int(column)]
        return RecordingError(f"{path}: column {name!r} holds {value[:40]!r}, not a number{sample}")
    if line := re.search(r"(?:Row #(\d+): )?Expected (\d+) columns, got (\d+)", text):
        row, expected, got = line.groups()
        sample = f" at sample {int(row) - before}" if row else ""
        return RecordingError(f"{path}: {got} cells instead of {expected}{sample}; is the file cut off?")
    if "Empty CSV" in text:
        return RecordingError(f"{path}: too few samples: 0, at least 2 are needed")
    return RecordingError(f"{path}: {_UNREADABLE}: {' '.join(text.split())[:200]}")


def _opened_parquet(budget: Budget) -> OpenTable:
    from pyarrow import parquet

    with foreign(budget.path, _DAMAGED):
        schema = parquet.read_schema(budget.path)
        frame = (schema.metadata or {}).get(IMU_FRAME.encode(), b"").decode()
    names = tuple(schema.names)
    return OpenTable(names, lambda found, rows: _parquet_batches(found, rows or MOST_ROWS, budget), frame or None)


def _parquet_batches(columns: tuple[str, ...], rows: int, budget: Budget) -> Iterator[Array]:
    """Reads page by page. Raises LimitError if row groups are larger than the budget allows. Only their totals are
    read: Arrow ends the process if a column's statistics, which it reads along with the column's size, contradict its
    type.
    """
    from pyarrow import parquet

    path, at_once = budget.path, 8192  # rows: Arrow keeps what the largest batch has taken
    with foreign(path, _DAMAGED), parquet.ParquetFile(path, buffer_size=1 << 16, pre_buffer=False) as file:
        groups = (file.metadata.row_group(k) for k in range(file.metadata.num_row_groups))
        largest = max((group.total_byte_size / max(group.num_columns, 1) for group in groups), default=0.0)
        budget.require_unpacked(largest, "a column of a row group")
        count = min(rows, rows_at_once(len(columns)), at_once)
        yield from _batches_of(file.iter_batches(count, columns=list(columns), use_threads=False), columns, str(path))


def _batches_of(tables: Iterable[pa.RecordBatch], columns: Sequence[str], source: str) -> Iterator[Array]:
    """Yields these columns of consecutive record batches; a null is a blank cell. Integers are rounded to the nearest
    double. Raises RecordingError: a column is not numeric, or NaN in a row without blank cells.
    """
    first = 0
    for table in tables:
        values = np.empty((len(columns), table.num_rows))
        blank = np.zeros(values.shape, dtype=bool)
        for i, name in enumerate(columns):
            cells = _numbers(table.column(name), name, source)
            if cells.null_count:
                blank[i] = np.from_dlpack(cells.is_null().cast("uint8"))
                cells = cells.fill_null(0.0)
            values[i] = np.from_dlpack(cells)  # `to_numpy` would import pandas
        wrong = np.isnan(values) & ~blank.any(axis=0)
        if wrong.any():
            row, column = np.argwhere(wrong.T)[0]
            raise RecordingError(f"{source}: column {columns[column]!r} is nan at sample {first + row}")
        values[blank] = np.nan
        yield values
        first += table.num_rows


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


CSV = TableReader("CSV table", (".csv", ".csv.gz", ".csv.bz2", ".csv.zst"), _is_text, _opened_csv)
"""Read a megabyte at a time."""
PARQUET = TableReader("Parquet table", (".parquet", ".pq"), lambda path: begins_with(path, b"PAR1"), _opened_parquet)
"""Memory does not grow with the size of the row groups."""
