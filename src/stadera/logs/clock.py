"""Corrects the time of a log's rows: skips the few that repeat, and splits the log where the clock was set back."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stadera.errors import RecordingError
from stadera.logs.sampling import GAP_FACTOR
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
