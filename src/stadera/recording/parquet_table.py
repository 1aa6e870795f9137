"""The flat table as Parquet."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import pyarrow as pa
from pyarrow import parquet

from stadera.errors import RecordingError
from stadera.recording.assemble import recordings
from stadera.recording.columns import IMU_FRAME, Layout, layout
from stadera.recording.recording import Recording
from stadera.recording.topics import Topics

MAGIC = b"PAR1"
BUFFER_BYTES = 1 << 18
BATCH_ROWS = 65536


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

    def stream(
        self, path: Path, *, joints: Sequence[str] | None, require: Collection[str], rows: int | None, topics: Topics
    ) -> Iterator[Recording]:
        """See `stadera.recording.stream`."""
        topics.refuse(str(path), self.name)
        try:
            schema = parquet.read_schema(path)
        except pa.ArrowException as error:
            raise _damaged(path, error) from None
        frame = (schema.metadata or {}).get(IMU_FRAME.encode())
        found = layout(schema.names, str(path), joints, require)
        found = replace(found, imu_frame=None if frame is None else frame.decode())
        return recordings(_batches(path, found, rows or BATCH_ROWS), found, str(path), rows)


def _batches(path: Path, found: Layout, rows: int) -> Iterator[pa.RecordBatch]:
    try:
        with parquet.ParquetFile(path, buffer_size=BUFFER_BYTES, pre_buffer=False) as file:
            yield from file.iter_batches(min(rows, BATCH_ROWS), columns=list(found.columns), use_threads=False)
    except (pa.ArrowException, OSError) as error:
        raise _damaged(path, error) from None


def _damaged(path: Path, error: Exception) -> RecordingError:
    return RecordingError(f"{path}: damaged Parquet file: {' '.join(str(error).split())[:200]}")
