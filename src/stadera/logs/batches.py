"""Converts batches of a table's columns to recordings: drops rows with blanks, checks every value, corrects the clock,
cuts even chunks.

A batch is an array (columns, rows) of consecutive rows, its columns those of `Layout.columns`; a blank cell is NaN.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stadera.errors import RecordingError
from stadera.limits import Budget
from stadera.logs.columns import Layout
from stadera.logs.recording import Imu, OtherJoints, Recording, check_values, with_velocity
from stadera.logs.sampling import GAP_FACTOR
from stadera.logs.topics import DESIRED, PD_DOUBT, PdGains
from stadera.types import Array, Bools


@dataclass
class RowClock:
    """Makes the time of consecutive chunks of one log strictly increasing.

    A sample at most GAP_FACTOR mean steps earlier than the previous one is skipped: a repeated row, or one out of
    order. If it is further back, the clock was set back, by an unknown amount: what follows is placed after a gap. If
    more than this share of the steps so far stands still or runs back, the column is not a clock.
    """

    source: str
    most_wrong: float = 0.01
    _first: float = np.nan  # s
    _last: float = -np.inf  # s, of the last sample kept, after shifts
    _previous: float = -np.inf  # s, of the last sample read, kept or not, before shifts
    _shift: float = 0.0  # s
    _wrong: int = 0

    def __call__(self, time: Array, samples: NDArray[np.int64]) -> tuple[Array, Bools, tuple[str, ...]]:
        """Corrects a chunk's time (samples,) [s], given the samples' indices in the log. Returns time, the samples to
        keep, and notes. Raises RecordingError: too many samples repeat or run back.
        """
        raw, time, kept = time, time + self._shift, np.ones(len(time), dtype=bool)
        falls = np.diff(raw, prepend=self._previous) <= 0
        self._first = float(time[0]) if np.isnan(self._first) else self._first
        dropped, notes, at = 0, [], 0
        while at < len(time):
            wrong = np.flatnonzero(np.diff(time[at:], prepend=self._last) <= 0)
            stop = at + int(wrong[0]) if len(wrong) else len(time)
            self._last = float(time[stop - 1]) if stop > at else self._last
            if stop == len(time):
                break
            if falls[stop]:
                self._count(float(time[stop]), int(samples[stop]))
            if back := self._set_back(float(time[stop]), int(samples[stop])):
                notes.append(
                    f"time is set back at sample {samples[stop]}, {self._last - self._shift:.3f} to {raw[stop]:.3f} s: "
                    f"the log is split there, what follows is put {back:.3g} s later"
                )
                self._shift += back
                time[stop:] = raw[stop:] + self._shift
                at = stop
            else:
                kept[stop], dropped, at = False, dropped + 1, stop + 1
        self._previous = float(raw[-1]) if len(raw) else self._previous
        if dropped:
            notes.append(f"left out {dropped} samples whose time repeats or runs back")
        return time, kept, tuple(notes)

    def _set_back(self, time: float, sample: int) -> float:
        """Shift for this sample and all after it [s]; 0 for a single sample out of order."""
        gap = GAP_FACTOR * (self._last - self._first) / sample
        return 0.0 if time >= self._last - gap else self._last + 2.0 * gap - time

    def _count(self, time: float, sample: int) -> None:
        self._wrong += 1
        if self._wrong <= self.most_wrong * sample:
            return
        what = "stands still" if time == self._last else "runs back"
        raise RecordingError(
            f"{self.source}: column 'time' {what} at sample {sample} ({self._last:.6f} to {time:.6f} s)"
        )


MOST_ROWS = 32768
"""Rows of a batch, or of a chunk of a log."""


def rows_at_once(columns: int) -> int:
    """Number of rows in a batch, smaller for wide tables."""
    return max(1, min(MOST_ROWS, (1 << 22) // max(columns, 1)))


def recordings(batches: Iterable[Array], layout: Layout, source: str, rows: int | None) -> Iterator[Recording]:
    """Yields recordings of `rows` samples each (the last one shorter; None: a single one) from batches of any length.

    A blank cell is a dropout: its row is removed, counted and noted.

    Raises:
        RecordingError: a value is not finite, time is not that of a clock (`RowClock`), or there are fewer than two
            samples. Names the source, the column and the sample, counted from 0 over the whole log.
    """
    clock, row, samples = RowClock(source), 0, 0
    for batch in _rebatched(in_si(batches, layout), rows):
        chunk = _recording(batch, layout, source, row, clock)
        row += batch.shape[1]
        if chunk is not None:
            samples += len(chunk)
            yield chunk
    if samples < 2:
        blank = f" without blank cells among {row}" if row > samples else ""
        raise RecordingError(f"{source}: too few samples: {samples}{blank}, at least 2 are needed")


def within(batches: Iterable[Array], budget: Budget, rows: int | None) -> Iterator[Array]:
    """Yields the batches within the budget, else raises LimitError; with `rows` None they count as kept in memory."""
    for batch in budget.timed(batches):
        if rows is None:
            budget.hold(batch.nbytes)
        yield batch


def in_si(batches: Iterable[Array], layout: Layout) -> Iterator[Array]:
    """Yields the batches with every column multiplied by its factor."""
    factors = np.array([layout.factors.get(name, 1.0) for name in layout.columns])[:, None]
    return (batch * factors if layout.factors else batch for batch in batches)


def _rebatched(batches: Iterable[Array], rows: int | None) -> Iterator[Array]:
    waiting: list[Array] = []
    count = 0
    for batch in batches:
        waiting.append(batch)
        count += batch.shape[1]
        if rows is not None and count >= rows:
            whole, full = np.concatenate(waiting, axis=1), count - count % rows
            yield from (whole[:, start : start + rows] for start in range(0, full, rows))
            waiting, count = [whole[:, full:]], count - full
    if count:
        yield np.concatenate(waiting, axis=1)


def _recording(batch: Array, layout: Layout, source: str, first: int, clock: RowClock) -> Recording | None:
    values, samples, notes = _without_dropouts(batch, layout.columns, first)
    if not len(samples):
        return None
    check_values(values.T, layout.columns, source, samples)
    time, kept, more = clock(values[0], samples)
    if not kept.any():
        return None
    time, values, notes = time[kept], values if kept.all() else values[:, kept], notes + more
    return _of_columns(time, values, layout, source, (layout.notes if first == 0 else ()) + notes)


def _of_columns(time: Array, values: Array, layout: Layout, source: str, notes: tuple[str, ...]) -> Recording:
    """Makes a recording from a layout and its columns, `values` (columns, samples)."""
    place = {name: i for i, name in enumerate(layout.columns)}

    def block(columns: tuple[str, ...]) -> Array:
        start = place[columns[0]]  # the columns of a block are contiguous
        return values[start : start + len(columns)].T

    imu = {key: block(columns) for key, columns in layout.imu.items()}
    channels: dict[str, Any] = {channel: block(columns) for channel, columns in layout.channels.items()}
    others = {channel: block(columns) for channel, columns in layout.others.items()}
    desired = {name: channels.pop(name) for name in DESIRED if name in channels}
    recording = Recording(
        time=time,
        joints=layout.joints,
        imu=Imu(**imu, frame=layout.imu_frame) if imu else None,
        foot_force={foot: block(columns) for foot, columns in layout.force.items()},
        foot_contact={foot: values[place[column]] > 0.5 for foot, column in layout.contact.items()},
        others=OtherJoints(layout.other_joints, **others) if others else None,
        source=source,
        notes=notes,
        **channels,
    )
    return recording if layout.pd is None else _with_pd_effort(recording, layout.pd, desired)


def _with_pd_effort(recording: Recording, pd: PdGains, desired: dict[str, Array]) -> Recording:
    """Computes efforts from the joint controllers' law: the commanded torques, not the actual ones."""
    moving = with_velocity(recording)
    if moving.velocity is None:
        raise RecordingError(f"{recording.source}: too few samples for joint velocities, which --pd needs")
    try:
        effort = pd.effort(moving.position, moving.velocity, moving.joints, desired)
    except RecordingError as error:
        raise RecordingError(f"{recording.source}: --pd {pd}: {error}") from None
    note = f"efforts made of desired positions, kp,kd = {pd} N·m/rad, N·m·s/rad"
    return replace(moving, effort=effort, notes=(*moving.notes, note), doubts=(*moving.doubts, PD_DOUBT))


def _without_dropouts(
    batch: Array, columns: Sequence[str], first: int
) -> tuple[Array, NDArray[np.int64], tuple[str, ...]]:
    """The rows without blank cells, their indices in the log, and a note on the others."""
    blank, samples = np.isnan(batch), np.arange(first, first + batch.shape[1])
    valid: Bools = np.logical_not(blank.any(axis=0))
    if valid.all():
        return batch, samples, ()
    holes = int(np.count_nonzero(np.diff(valid.astype(np.int8), prepend=1) == -1))
    at = int(np.argmin(valid))
    name = columns[int(np.argmax(blank[:, at]))]
    note = (
        f"dropped {np.count_nonzero(~valid)} of {len(valid)} samples with blank cells, in {holes} "
        f"dropout{'s' * (holes > 1)}, the first at sample {samples[at]}, column {name!r}"
    )
    return batch[:, valid], samples[valid], (note,)
