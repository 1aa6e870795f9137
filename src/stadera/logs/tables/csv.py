"""The flat table as CSV: comma-separated, one header line, blank cells for dropouts."""

from __future__ import annotations

import csv
import re
from collections.abc import Collection, Iterator, Sequence
from pathlib import Path

from stadera.errors import RecordingError
from stadera.logs.batches import Batch, recordings
from stadera.logs.columns import layout
from stadera.logs.recording import Recording
from stadera.logs.tables.arrow import batch_of
from stadera.logs.topics import Topics

BLOCK_BYTES = 1 << 20


class CsvTable:
    """Reads the flat table from CSV, a megabyte at a time."""

    name = "CSV table"
    suffixes = (".csv",)

    def accepts(self, path: Path) -> bool:
        """A file whose beginning is UTF-8 text."""
        if not path.is_file():
            return False
        with path.open("rb") as file:
            head = file.read(4096)
        try:
            head[: head.rfind(b"\n") + 1 or None].decode("utf-8")
        except UnicodeDecodeError:
            return False
        return bool(head) and b"\0" not in head

    def stream(
        self, path: Path, *, joints: Sequence[str] | None, require: Collection[str], rows: int | None, topics: Topics
    ) -> Iterator[Recording]:
        """See `stadera.logs.stream`."""
        topics.refuse(str(path), self.name)
        header = _header(path)
        found = layout(header, str(path), joints, require)
        return recordings(_batches(path, header, found.columns), found, str(path), rows)


def _header(path: Path) -> list[str]:
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            return [name.strip() for name in next(csv.reader(file, skipinitialspace=True), [])]
    except (csv.Error, UnicodeDecodeError) as error:
        raise RecordingError(f"{path}: not a readable CSV table: {error}") from None


def _batches(path: Path, header: list[str], columns: tuple[str, ...]) -> Iterator[Batch]:
    import pyarrow as pa
    from pyarrow import csv as pacsv

    try:
        # one thread: Arrow then names the row of a bad cell
        with pacsv.open_csv(
            path,
            read_options=pacsv.ReadOptions(use_threads=False, block_size=BLOCK_BYTES, column_names=header, skip_rows=1),
            convert_options=pacsv.ConvertOptions(
                include_columns=list(columns),
                column_types=dict.fromkeys(columns, pa.float64()),
                null_values=[""],
                strings_can_be_null=True,
            ),
        ) as reader:
            for batch in reader:
                yield batch_of(batch, columns, str(path))
    except pa.ArrowInvalid as error:
        raise _explained(str(error), path, header) from None


def _explained(text: str, path: Path, header: list[str]) -> RecordingError:
    """Arrow's message in the words of the log: its column by name, its row as a sample."""
    if cell := re.search(r"column #(\d+): (?:Row #(\d+): )?.*invalid value '(.*)'", text, re.S):
        column, row, value = cell.groups()
        sample = f" at sample {int(row) - 2}" if row else ""
        return RecordingError(f"{path}: column {header[int(column)]!r} holds {value[:40]!r}, not a number{sample}")
    if line := re.search(r"(?:Row #(\d+): )?Expected (\d+) columns, got (\d+)", text):
        row, expected, got = line.groups()
        sample = f" at sample {int(row) - 2}" if row else ""
        return RecordingError(f"{path}: {got} cells instead of {expected}{sample}; is the file cut off?")
    if "Empty CSV" in text:
        return RecordingError(f"{path}: too few samples: 0, at least 2 are needed")
    return RecordingError(f"{path}: not a readable CSV table: {' '.join(text.split())[:200]}")
