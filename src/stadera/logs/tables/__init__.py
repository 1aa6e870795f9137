"""Tables in files: their rows as recordings. CSV and Parquet (`arrow`), NumPy's and MATLAB's arrays (`arrays`)."""

from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from stadera.limits import Budget
from stadera.logs.batches import table_recordings, within
from stadera.logs.columns import layout
from stadera.logs.recording import Recording
from stadera.logs.topics import LogFile
from stadera.types import Array


@dataclass(frozen=True, eq=False)
class OpenTable:
    """A file whose header was read."""

    names: tuple[str, ...]  # of the columns
    batches: Callable[[tuple[str, ...], int | None], Iterable[Array]]  # of some columns, for recordings of so many rows
    imu_frame: str | None = None
    orders: tuple[tuple[str, ...], ...] = ()  # see `ReadOptions`


@dataclass(frozen=True)
class TableReader:
    """Reader of one format of tables, see `stadera.logs.reader.Reader`."""

    name: str
    suffixes: tuple[str, ...]
    accepts: Callable[[Path], bool]  # True if the content at a path has this format
    opened: Callable[[Budget], OpenTable]  # reads the header of the budget's file

    def header(self, path: Path) -> tuple[str, ...]:
        """Names of the columns."""
        return self.opened(Budget(path)).names

    def stream(
        self, log: LogFile, *, joints: Sequence[str] | None, require: Collection[str], rows: int | None
    ) -> Iterator[Recording]:
        """See `stadera.logs.stream`."""
        path, budget = str(log.path), Budget(log.path, log.reading.limits)
        table = self.opened(budget)
        budget.require_columns(table.names)
        reading = replace(log.reading, orders=table.orders)
        found = layout(table.names, path, joints, require, reading, log.topics, self.name)
        batches = within(table.batches(found.recorded, rows), budget, rows)
        return table_recordings(batches, replace(found, imu_frame=table.imu_frame), path, rows)
