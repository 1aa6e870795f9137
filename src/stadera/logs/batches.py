"""Converts batches of a table's columns to recordings: computes or converts stamps, merges rows with different stamps,
drops rows with blanks or repeated times, checks every value, cuts even chunks.

A batch is an array (columns, rows) of consecutive rows, its columns those of `Layout.columns`; a blank cell is NaN.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from itertools import chain

import numpy as np
from numpy.typing import NDArray

from stadera.errors import RecordingError
from stadera.limits import Budget
from stadera.logs.columns import TIME, Layout
from stadera.logs.recording import Recording, check_values, complete, fields_of, no_clock, with_velocity
from stadera.logs.topics import DESIRED, PD_DOUBT, PdGains
from stadera.logs.units import FACTORS, longer_unit, unix_unit
from stadera.types import Array, Bools

MOST_ROWS = 32768
"""Rows of a batch, or of a chunk of a log."""


@dataclass
class RowClock:
    """Tells the samples of consecutive chunks of one log whose time repeats or runs back, which are left out.

    If more than a share `most_wrong` of the samples so far does, the column is not a clock.
    """

    source: str
    most_wrong: float = 0.01
    _last: float = -np.inf  # s, of the last sample kept
    _wrong: int = 0

    def __call__(self, time: Array, samples: NDArray[np.int64]) -> Bools:
        """Which samples of a chunk to keep, given its time (samples,) [s] and their indices in the log. Raises
        RecordingError: too many repeat or run back.
        """
        before = np.maximum.accumulate(np.concatenate([[self._last], time]))
        kept = time > before[:-1]
        wrong = np.flatnonzero(~kept)
        counts = self._wrong + 1 + np.arange(len(wrong))
        for at in wrong[counts > self.most_wrong * samples[wrong]][:1]:
            raise no_clock(self.source, int(samples[at]), before[at], time[at])
        self._last, self._wrong = float(before[-1]), self._wrong + len(wrong)
        return kept


def rows_at_once(columns: int) -> int:
    """Number of rows in a batch, smaller for wide tables."""
    return max(1, min(MOST_ROWS, (1 << 22) // max(columns, 1)))


def recordings(
    batches: Iterable[Array], layout: Layout, source: str, rows: int | None, fewest: int = 2
) -> Iterator[Recording]:
    """Yields recordings of `rows` samples each (the last one shorter; None: a single one) from batches of any length.

    A blank cell is a dropout: its row is removed, counted and noted.

    Raises:
        RecordingError: a value is not finite, time is not that of a clock (`RowClock`), or there are fewer than
            `fewest` samples. Names the source, the column and the sample, counted from 0 over the whole log.
    """
    clock, row, samples, blanks = RowClock(source), 0, 0, np.zeros(len(layout.columns), dtype=np.int64)
    for batch in _rebatched(in_si(batches, layout), rows):
        blanks += np.isnan(batch).sum(axis=1)
        chunk = _recording(batch, layout, source, row, clock)
        row += batch.shape[1]
        if chunk is not None:
            samples += len(chunk)
            yield chunk
    if samples < fewest:
        most = int(blanks.argmax())
        blank = f" without blank cells among {row}" if row > samples else ""
        where = f"; {layout.columns[most]!r} is blank in {blanks[most]}" if blanks[most] else ""
        raise RecordingError(f"{source}: too few samples: {samples}{blank}, at least {fewest} are needed{where}")


def within(batches: Iterable[Array], budget: Budget, rows: int | None) -> Iterator[Array]:
    """Yields the batches within the budget, else raises LimitError; with `rows` None they count as kept in memory. Only
    the time spent producing them counts, from the first one on.
    """

    def counted() -> Iterator[Array]:
        budget.resume()
        for batch in batches:
            budget.check_time()
            if rows is None:
                budget.hold(batch.nbytes)
            budget.pause()
            yield batch
            budget.resume()
        budget.check_time()

    budget.pause()
    return counted()


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
    samples, notes = complete(np.isnan(batch), layout.columns, first)
    if not len(samples):
        return None
    values = batch[:, samples - first] if notes else batch
    check_values(values[:1].T, (TIME,), source, samples)
    kept = clock(values[0], samples)
    if not kept.any():
        return None
    if not kept.all():
        notes += (f"left out {np.count_nonzero(~kept)} samples whose time repeats or runs back",)
        values, samples = values[:, kept], samples[kept]
    try:
        return _of_columns(values, layout, source, (*(layout.notes if first == 0 else ()), *notes))
    except RecordingError:
        check_values(values.T, layout.columns, source, samples)  # the same, with the sample's place in the log
        raise


def _of_columns(values: Array, layout: Layout, source: str, notes: tuple[str, ...]) -> Recording:
    """Makes a recording from a layout and its columns, `values` (columns, samples)."""
    ends = np.cumsum([1, *map(len, layout.groups.values())])
    blocks = dict(zip(layout.groups, (block.T for block in np.split(values, ends)[1:-1]), strict=True))
    arrays = {TIME: values[0]} | {n: v[:, 0] > 0.5 if n.endswith(".contact") else v for n, v in blocks.items()}
    desired = {name: arrays.pop(name) for name in DESIRED if name in arrays}
    fields = fields_of(arrays, layout.imu_frame, layout.others)
    recording = Recording(joints=layout.joints, source=source, notes=notes, **fields)
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


def table_recordings(batches: Iterable[Array], layout: Layout, source: str, rows: int | None) -> Iterator[Recording]:
    """Like `recordings`, for batches whose rows are the columns that the log records (`Layout.recorded`).

    Stamps in whole milliseconds, microseconds or nanoseconds since 1970 are recognised if no unit is given. A table
    without time gets stamps from its rate. If joints and IMU have different stamps, and so separate rows, blank in the
    other's columns, the IMU is interpolated at the joints' stamps.
    """
    batches = iter(batches)
    if layout.rate_hz is not None:
        batches = _stamped(batches, layout.rate_hz)
    first = next(batches, np.empty((len(layout.columns), 0)))
    batches, stamps = chain([first], batches), first[0, ~np.isnan(first[0])]
    if layout.rate_hz is None and not layout.stamped and (unit := unix_unit(stamps)):
        note = f"converted to SI units: time, which is Unix time in {unit}"
        factors = {**layout.factors, TIME: FACTORS[TIME][unit]}
        layout = replace(layout, factors=factors, notes=(*layout.notes, note))
    factor = layout.factors.get(TIME, 1.0)
    if unit := longer_unit(stamps, factor):
        taken = next((name for name, known in FACTORS[TIME].items() if known == factor), f"{factor:g} s")
        raise RecordingError(f"{source}: column 'time' seems to be in {unit}, not in {taken}; add --units {unit}")
    if is_interleaved(first, layout):
        batches = aligned(in_si(batches, layout), layout)
        note = "rows without joint positions are left out; the IMU is interpolated at the stamps of the others"
        layout = replace(layout, factors={}, notes=(*layout.notes, note))
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
    apart = any(_of_imu(layout)) and bool(imu.any()) and bool(np.count_nonzero(joints & imu) < few * many)
    return apart or many < few * batch.shape[1]


def aligned(batches: Iterable[Array], layout: Layout) -> Iterator[Array]:
    """Yields the joints' rows, with the IMU's values interpolated at their stamps; blank where the IMU has a gap. The
    batches are in SI units.
    """
    from stadera.logs.bags.alignment import Alignment, Track

    columns, is_imu = layout.columns, _of_imu(layout)
    of_imu, of_joints = np.flatnonzero(is_imu).tolist(), np.flatnonzero(~is_imu)[1:].tolist()
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
    blank, is_imu = np.isnan(batch), _of_imu(layout)
    stamped = ~blank[0]
    return stamped & ~blank[~is_imu].any(axis=0), stamped & ~blank[is_imu].any(axis=0)


def _of_imu(layout: Layout) -> Bools:
    """Which of the layout's columns are the IMU's."""
    return np.array([name.startswith("imu.") for name in layout.columns])
