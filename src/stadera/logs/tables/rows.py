"""Tables as logs: converts their rows to recordings, computes or converts stamps, merges rows with different stamps."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path

import numpy as np

from stadera.limits import Budget
from stadera.logs.batches import in_si, recordings, within
from stadera.logs.columns import TIME, Layout, layout
from stadera.logs.recording import Recording
from stadera.logs.topics import LogFile
from stadera.logs.units import FACTORS, unix_unit
from stadera.types import Array, Bools

INTERLEAVED = "rows without joint positions are left out; the IMU is interpolated at the stamps of the others"


@dataclass(frozen=True, eq=False)
class OpenTable:
    """A file whose header was read."""

    names: tuple[str, ...]  # of the columns
    batches: Callable[[tuple[str, ...], int | None], Iterable[Array]]  # of some columns, for recordings of so many rows
    imu_frame: str | None = None


class TableReader(ABC):
    """Reader of one format of tables, see `stadera.logs.reader.Reader`."""

    name: str
    suffixes: tuple[str, ...]

    @abstractmethod
    def accepts(self, path: Path) -> bool:
        """True if the content at `path` has this format."""

    @abstractmethod
    def opened(self, budget: Budget) -> OpenTable:
        """Reads the header of the budget's file."""

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
        found = layout(table.names, path, joints, require, log.reading, log.topics, self.name)
        batches = within(table.batches(found.recorded, rows), budget, rows)
        return table_recordings(batches, replace(found, imu_frame=table.imu_frame), path, rows)


def table_recordings(batches: Iterable[Array], layout: Layout, source: str, rows: int | None) -> Iterator[Recording]:
    """Like `recordings`, for batches whose rows are the columns that the log records (`Layout.recorded`).

    Stamps in whole milliseconds, microseconds or nanoseconds since 1970 are recognised if no unit is given. A table
    without time gets stamps from its rate. If joints and IMU have different stamps, and so separate rows, blank in the
    other's columns, the IMU is interpolated at the joints' stamps.
    """
    batches = iter(batches)
    if layout.rate_hz is not None:
        batches = _stamped(batches, layout.rate_hz)
    first = next(batches, None)
    if first is None:
        yield from recordings((), layout, source, rows)
        return
    batches = chain([first], batches)
    if layout.rate_hz is None and not layout.stamped and (unit := unix_unit(first[0, ~np.isnan(first[0])])):
        note = f"converted to SI units: time, which is Unix time in {unit}"
        factors = {**layout.factors, TIME: FACTORS[TIME][unit]}
        layout = replace(layout, factors=factors, notes=(*layout.notes, note))
    if is_interleaved(first, layout):
        batches = aligned(in_si(batches, layout), layout)
        layout = replace(layout, factors={}, notes=(*layout.notes, INTERLEAVED))
    yield from recordings(batches, layout, source, rows)


def _stamped(batches: Iterable[Array], rate_hz: float) -> Iterator[Array]:
    row = 0
    for batch in batches:
        samples = batch.shape[1]
        yield np.vstack([np.arange(row, row + samples) / rate_hz, batch])
        row += samples


def is_interleaved(batch: Array, layout: Layout, few: float = 0.5) -> bool:
    """True if most rows at the log's beginning lack either the joints' values or the IMU's.

    Below a share of `few` complete rows [1] a table counts as interleaved: so many blanks are not a sensor's dropouts.
    """
    joints, imu = _complete(batch, layout)
    if not joints.any():
        return False
    many = int(np.count_nonzero(joints))
    apart = bool(layout.imu) and bool(imu.any()) and bool(np.count_nonzero(joints & imu) < few * many)
    return apart or many < few * batch.shape[1]


def aligned(batches: Iterable[Array], layout: Layout) -> Iterator[Array]:
    """Yields the joints' rows, with the IMU's values interpolated at their stamps; blank where the IMU has a gap. The
    batches are in SI units.
    """
    from stadera.logs.bags.alignment import Alignment, Track

    columns = layout.columns
    of_imu = [columns.index(name) for names in layout.imu.values() for name in names]
    of_joints = [k for k in range(1, len(columns)) if k not in of_imu]
    tracks = [Track("joints", [columns[k] for k in of_joints])]
    if of_imu:
        tracks.append(Track("IMU", [columns[k] for k in of_imu]))
    alignment = Alignment(tracks)
    order = np.argsort([0, *of_joints, *of_imu])
    for batch in chain(batches, [None]):
        if batch is not None:
            complete = _complete(batch, layout)
            for track, rows, chosen in zip(tracks, (of_joints, of_imu), complete, strict=False):
                track.extend(np.round(1e9 * batch[0, chosen]).astype(np.int64), batch[rows][:, chosen].T)
        stamps, values = alignment.rows(final=batch is None)
        if len(stamps):
            yield np.vstack([stamps / 1e9, values.T])[order]


def _complete(batch: Array, layout: Layout) -> tuple[Bools, Bools]:
    """Rows in which all of the joints' columns have values, and rows in which all of the IMU's have."""
    blank = np.isnan(batch)
    imu = {name for names in layout.imu.values() for name in names}
    is_imu = np.array([name in imu for name in layout.columns])
    stamped = ~blank[0]
    return stamped & ~blank[~is_imu].any(axis=0), stamped & ~blank[is_imu].any(axis=0)
