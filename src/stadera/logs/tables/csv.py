"""Reads the flat table from CSV: one header line, blank cells for dropouts; plain or compressed by gzip, bzip2 or
zstd.
"""

import csv
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from stadera.boundary import foreign
from stadera.errors import RecordingError
from stadera.limits import Budget
from stadera.logs.batches import Batch
from stadera.logs.tables.rows import OpenTable, TableReader, batch_of

BLOCK_BYTES = 1 << 20
_PIECE_BYTES = 1 << 12
_UNREADABLE = "not a readable CSV table"
_PACKED = {b"\x1f\x8b": "gzip", b"BZh": "bz2", b"\x28\xb5\x2f\xfd": "zstd"}
_SEPARATORS = (";", "\t", "|")


@dataclass(frozen=True)
class Dialect:
    """Format of a table: names of columns, lines before the first sample, separator of columns, sign of decimals."""

    header: tuple[str, ...]
    skip: int
    separator: str = ","
    decimal: str = "."


class CsvTable(TableReader):
    """Reads the flat table from CSV, a megabyte at a time."""

    name = "CSV table"
    suffixes = (".csv", ".csv.gz", ".csv.bz2", ".csv.zst")

    def accepts(self, path: Path) -> bool:
        """True for a file whose beginning, unpacked, is UTF-8 text."""
        if not path.is_file():
            return False
        head = _head(path, 4096)
        try:
            head[: head.rfind(b"\n") + 1 or None].decode("utf-8")
        except UnicodeDecodeError:
            return False
        return bool(head) and b"\0" not in head

    def opened(self, budget: Budget) -> OpenTable:
        """See `TableReader`."""
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
            while len(found) < size and (some := unpacked.read(_PIECE_BYTES)):
                found += some
    except (pa.ArrowException, OSError):  # damaged or cut off: the part before it is still the beginning
        pass
    return bytes(found[:size])


def _packed(head: bytes) -> str | None:
    return next((name for magic, name in _PACKED.items() if head.startswith(magic)), None)


def _dialect(path: Path) -> Dialect:
    """Determines the format. Comment lines (#) before the header are skipped; tables with ; may use decimal commas."""
    lines = _head(path, BLOCK_BYTES).decode("utf-8-sig", errors="ignore").splitlines()
    skip = next((k for k, line in enumerate(lines) if line.strip() and not line.startswith("#")), 0)
    first, second = [*lines[skip : skip + 2], "", ""][:2]
    separator = next((sign for sign in _SEPARATORS if sign in first and "," not in first), ",")
    decimal = "," if separator == ";" and re.search(r"\d,\d", second) else "."
    with foreign(path, _UNREADABLE):
        header = next(csv.reader([first], delimiter=separator, skipinitialspace=True), [])
    return Dialect(tuple(name.strip() for name in header), skip + 1, separator, decimal)


def _batches(path: Path, dialect: Dialect, columns: tuple[str, ...]) -> Iterator[Batch]:
    import pyarrow as pa
    from pyarrow import csv as pacsv

    # with one thread Arrow names the row of a bad cell
    reading = pacsv.ReadOptions(
        use_threads=False, block_size=BLOCK_BYTES, column_names=dialect.header, skip_rows=dialect.skip
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
                for batch in reader:
                    yield batch_of(batch, columns, str(path))
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
