"""The flat table as Parquet."""

from collections.abc import Collection, Iterator, Sequence
from dataclasses import replace
from pathlib import Path

from stadera.boundary import foreign
from stadera.limits import Budget
from stadera.logs.batches import MOST_ROWS, Batch, rows_at_once, within
from stadera.logs.columns import IMU_FRAME, layout
from stadera.logs.recording import Recording
from stadera.logs.tables.arrow import batch_of
from stadera.logs.tables.pages import check_pages
from stadera.logs.tables.rows import table_recordings
from stadera.logs.topics import LogFile

MAGIC = b"PAR1"
BUFFER_BYTES = 1 << 16
_ROWS = 8192  # decoded at once: Arrow keeps what the largest batch has taken
_DAMAGED = "damaged Parquet file"


class ParquetTable:
    """Reads the flat table from Parquet, page by page: memory does not grow with the size of the row groups."""

    name = "Parquet table"
    suffixes = (".parquet", ".pq")

    def accepts(self, path: Path) -> bool:
        """A file that begins with Parquet's magic bytes."""
        if not path.is_file():
            return False
        with path.open("rb") as file:
            return file.read(len(MAGIC)) == MAGIC

    def header(self, path: Path) -> tuple[str, ...]:
        """Names of the columns."""
        return _schema(path)[0]

    def stream(
        self, log: LogFile, *, joints: Sequence[str] | None, require: Collection[str], rows: int | None
    ) -> Iterator[Recording]:
        """See `stadera.logs.stream`."""
        path, budget = log.path, Budget(log.path, log.reading.limits)
        names, frame = _schema(path)
        budget.require_columns(names)
        found = layout(names, str(path), joints, require, log.reading, log.topics, self.name)
        found = replace(found, imu_frame=frame)
        batches = within(_batches(path, found.recorded, rows or MOST_ROWS, budget), budget, rows)
        return table_recordings(batches, found, str(path), rows)


def _schema(path: Path) -> tuple[tuple[str, ...], str | None]:
    """Names of the columns, and the IMU's frame."""
    from pyarrow import parquet

    with foreign(path, _DAMAGED):
        schema = parquet.read_schema(path)
        frame = (schema.metadata or {}).get(IMU_FRAME.encode(), b"").decode()
        return tuple(schema.names), frame or None


def _batches(path: Path, columns: tuple[str, ...], rows: int, budget: Budget) -> Iterator[Batch]:
    from pyarrow import parquet

    with foreign(path, _DAMAGED), parquet.ParquetFile(path, buffer_size=BUFFER_BYTES, pre_buffer=False) as file:
        check_pages(path, columns, budget)
        for batch in file.iter_batches(
            min(rows, rows_at_once(len(columns)), _ROWS), columns=list(columns), use_threads=False
        ):
            yield batch_of(batch, columns, str(path))
