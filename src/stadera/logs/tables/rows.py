"""Converts rows of a table to recordings: computes or converts stamps, merges rows with different stamps."""

from collections.abc import Iterable, Iterator
from dataclasses import replace
from itertools import chain

import numpy as np

from stadera.logs.batches import Batch, in_si, recordings
from stadera.logs.columns import TIME, Layout
from stadera.logs.recording import Recording
from stadera.logs.tables.interleaved import INTERLEAVED, aligned, is_interleaved
from stadera.logs.units import FACTORS, unix_unit
from stadera.types import Array


def table_recordings(batches: Iterable[Batch], layout: Layout, source: str, rows: int | None) -> Iterator[Recording]:
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
    if layout.rate_hz is None and not layout.stamped and (unit := unix_unit(_stamps(first))):
        note = f"converted to SI units: time, which is Unix time in {unit}"
        factors = {**layout.factors, TIME: FACTORS[TIME][unit]}
        layout = replace(layout, factors=factors, notes=(*layout.notes, note))
    if is_interleaved(first, layout):
        batches = aligned(in_si(batches, layout), layout)
        layout = replace(layout, factors={}, notes=(*layout.notes, INTERLEAVED))
    yield from recordings(batches, layout, source, rows)


def _stamps(batch: Batch) -> Array:
    time: Array = batch.values[0]
    return time if batch.blank is None else time[~batch.blank[0]]


def _stamped(batches: Iterable[Batch], rate_hz: float) -> Iterator[Batch]:
    row = 0
    for batch in batches:
        time = np.arange(row, row + len(batch)) / rate_hz
        blank = None if batch.blank is None else np.vstack([np.zeros(len(batch), dtype=bool), batch.blank])
        yield Batch(np.vstack([time, batch.values]), blank)
        row += len(batch)
