"""The flat table as Parquet."""

from collections.abc import Iterator
from pathlib import Path

from stadera.boundary import begins_with, foreign
from stadera.limits import Budget
from stadera.logs.batches import MOST_ROWS, Batch, rows_at_once
from stadera.logs.columns import IMU_FRAME
from stadera.logs.tables.pages import check_pages
from stadera.logs.tables.rows import OpenTable, TableReader, batch_of

MAGIC = b"PAR1"
BUFFER_BYTES = 1 << 16
_ROWS = 8192  # decoded at once: Arrow keeps what the largest batch has taken
_DAMAGED = "damaged Parquet file"


class ParquetTable(TableReader):
    """Reads the flat table from Parquet, page by page: memory does not grow with the size of the row groups."""

    name = "Parquet table"
    suffixes = (".parquet", ".pq")

    def accepts(self, path: Path) -> bool:
        """A file that begins with Parquet's magic bytes."""
        return begins_with(path, MAGIC)

    def opened(self, budget: Budget) -> OpenTable:
        """See `TableReader`."""
        names, frame = _schema(budget.path)
        return OpenTable(names, lambda columns, rows: _batches(columns, rows or MOST_ROWS, budget), frame)


def _schema(path: Path) -> tuple[tuple[str, ...], str | None]:
    """Names of the columns, and the IMU's frame."""
    from pyarrow import parquet

    with foreign(path, _DAMAGED):
        schema = parquet.read_schema(path)
        frame = (schema.metadata or {}).get(IMU_FRAME.encode(), b"").decode()
        return tuple(schema.names), frame or None


def _batches(columns: tuple[str, ...], rows: int, budget: Budget) -> Iterator[Batch]:
    from pyarrow import parquet

    path = budget.path
    with foreign(path, _DAMAGED), parquet.ParquetFile(path, buffer_size=BUFFER_BYTES, pre_buffer=False) as file:
        check_pages(path, columns, budget)
        for batch in file.iter_batches(
            min(rows, rows_at_once(len(columns)), _ROWS), columns=list(columns), use_threads=False
        ):
            yield batch_of(batch, columns, str(path))
