"""From Arrow tables to recordings: dropouts found and dropped, every value checked, chunks of even length."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from stadera.errors import RecordingError
from stadera.recording.columns import TIME, Layout
from stadera.recording.recording import Array, Imu, Recording

LARGEST = 1e15
"""Beyond this a value is no measurement; squares of it are still far from overflow."""


def recordings(batches: Iterable[pa.RecordBatch], layout: Layout, source: str, rows: int | None) -> Iterator[Recording]:
    """Recordings of `rows` samples each (the last shorter; None: one of all) from batches of any length.

    A blank cell is a dropout: its row is dropped, counted and named in the notes; the hole it leaves in time is for
    `split_gaps` to judge. NaN or infinity written out is an error.

    Raises:
        RecordingError: a value that is not a finite number, time that does not increase (across chunks too), fewer
            than two samples; names the source, the column and the sample (counted from 0 over the whole file).
    """
    last, row, samples = -np.inf, 0, 0
    for table in _rebatched(batches, rows):
        chunk = _recording(table, layout, source, row, last)
        row += table.num_rows
        if chunk is not None:
            last, samples = float(chunk.time[-1]), samples + len(chunk)
            yield chunk
    if samples < 2:
        blank = f" without blank cells among {row}" if row > samples else ""
        raise RecordingError(f"{source}: too few samples: {samples}{blank}, at least 2 are needed")


def _rebatched(batches: Iterable[pa.RecordBatch], rows: int | None) -> Iterator[pa.Table]:
    waiting: list[pa.RecordBatch] = []
    count = 0
    for batch in batches:
        waiting.append(batch)
        count += batch.num_rows
        while rows is not None and count >= rows:
            table = pa.Table.from_batches(waiting)
            yield table.slice(0, rows)
            waiting, count = table.slice(rows).to_batches(), count - rows
    if count:
        yield pa.Table.from_batches(waiting)


def _recording(table: pa.Table, layout: Layout, source: str, first: int, last: float) -> Recording | None:
    numbers = pa.table({name: _numbers(table.column(name), name, source) for name in layout.columns})
    numbers, samples, notes = _without_dropouts(numbers, first)
    if not len(samples):
        return None

    def block(columns: tuple[str, ...]) -> Array:
        # column after column in memory, seen as (samples, columns): filters and regressors work along time
        values = np.empty((len(columns), len(samples)))
        for i, name in enumerate(columns):
            values[i] = numbers.column(name).to_numpy()
            if not np.isfinite(values[i]).all():
                at = int(np.argmin(np.isfinite(values[i])))
                raise RecordingError(f"{source}: column {name!r} is {values[i, at]} at sample {samples[at]}")
            if np.abs(values[i]).max() > LARGEST:
                at = int(np.argmax(np.abs(values[i])))
                raise RecordingError(
                    f"{source}: column {name!r} is {values[i, at]:.3g} at sample {samples[at]}, more than any sensor "
                    f"says in SI units (at most {LARGEST:g})"
                )
        return values.T

    time = block((TIME,))[:, 0]
    _check_time(time, samples, source, last)
    imu = {key: block(columns) for key, columns in layout.imu.items()}
    return Recording(
        time=time,
        joints=layout.joints,
        imu=_imu(imu, layout.imu_frame) if imu else None,
        foot_force={foot: block(columns) for foot, columns in layout.force.items()},
        foot_contact={foot: block((column,))[:, 0] > 0.5 for foot, column in layout.contact.items()},
        source=source,
        notes=(layout.notes if first == 0 else ()) + notes,
        **{channel: block(columns) for channel, columns in layout.channels.items()},
    )


def _imu(quantities: Mapping[str, Array], frame: str | None) -> Imu:
    return Imu(quantities["angular_velocity"], quantities["linear_acceleration"], quantities.get("orientation"), frame)


def _numbers(column: pa.ChunkedArray, name: str, source: str) -> pa.ChunkedArray:
    kind = column.type
    if pa.types.is_float64(kind):
        return column
    numeric = (pa.types.is_integer, pa.types.is_floating, pa.types.is_boolean, pa.types.is_decimal, pa.types.is_null)
    if not any(test(kind) for test in numeric):
        raise RecordingError(f"{source}: column {name!r} holds {kind}, not numbers")
    if pa.types.is_boolean(kind):
        column = column.cast(pa.int8())
    return column.cast(pa.float64())


def _without_dropouts(table: pa.Table, first: int) -> tuple[pa.Table, NDArray[np.int64], tuple[str, ...]]:
    """The rows without blank cells, their numbers in the file, and a note on the others."""
    samples = np.arange(first, first + table.num_rows)
    blanks = {n: table.column(n) for n in table.column_names if table.column(n).null_count}
    if not blanks:
        return table, samples, ()
    valid = np.ones(table.num_rows, dtype=bool)
    for column in blanks.values():
        valid &= column.is_valid().to_numpy()
    holes = int(np.count_nonzero(np.diff(valid.astype(np.int8), prepend=1) == -1))
    at = int(np.argmin(valid))
    name = next(n for n, column in blanks.items() if not column[at].is_valid)
    note = (
        f"dropped {np.count_nonzero(~valid)} of {len(valid)} samples with blank cells, in {holes} "
        f"dropout{'s' * (holes > 1)}, the first at sample {samples[at]}, column {name!r}"
    )
    return table.filter(pa.array(valid)), samples[valid], (note,)


def _check_time(time: Array, samples: NDArray[np.int64], source: str, last: float) -> None:
    steps = np.diff(time, prepend=last)
    if steps.min() > 0:
        return
    at = int(np.argmax(steps <= 0))
    before = last if at == 0 else time[at - 1]
    what = "stands still" if steps[at] == 0 else "runs back"
    raise RecordingError(f"{source}: column 'time' {what} at sample {samples[at]} ({before:.6f} to {time[at]:.6f} s)")
