"""Merges streams with different time stamps, at the stamps of one of them.

Between two samples a stream is interpolated linearly, a quaternion along the great circle. A stream has no value in a
gap, before its beginning or after its end.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from stadera.errors import RecordingError
from stadera.logs.bags.container import BagSettings, Decoded, Stamps
from stadera.logs.columns import IMU_COLUMNS
from stadera.logs.sampling import GAP_FACTOR
from stadera.types import Array


class HeaderClock:
    """Stamps from headers with steps of their clock removed; times of recording if the stamps repeat or run back.

    A message cannot be recorded before it was stamped, so the least delay so far, received - stamp, is the offset of
    the recorder's clock from the sender's. Queues only add to a delay. So a delay below the least one, or a stamp that
    runs back by more than messages overtake each other, indicates a step of a clock.

    Attributes:
        steps, furthest: number of steps of the headers' clock that were removed, and the largest of them [s].
        silent: True if the headers' stamps are not those of a clock, and times of recording are used.
        delay, first_delay: least delay in the latest complete window [s], and in the first.
    """

    def __init__(self, settings: BagSettings) -> None:
        self._settings, self._jump = settings, round(1e9 * settings.header_jump)
        self.steps, self.furthest, self.silent = 0, 0.0, False
        self.delay, self.first_delay = np.nan, np.nan
        self._correction, self._least, self._period = 0, 0, 1
        self._stamp, self._received = 0, 0
        self._seen = self._wrong = 0
        self._window_start, self._window_least, self._windows = 0, np.inf, 0

    def __call__(self, stamps: Stamps, received: Stamps) -> Stamps:
        """The stamps to use for the next messages [ns], given their headers and times of recording."""
        if not self._seen:
            self._stamp, self._received = int(stamps[0]) - 1, int(received[0])
            self._least, self._window_start = int(received[0] - stamps[0]), self._received
        self._decide(stamps)
        undone = received if self.silent else self._without_steps(stamps, received)
        self._watch_delay(undone, received)
        self._stamp, self._received = int(stamps[-1]), int(received[-1])
        return undone

    def _decide(self, stamps: Stamps) -> None:
        """Decides from the beginning of the log whether the stamps are those of a clock."""
        if self._seen < self._settings.head:
            first, self._seen = not self._seen, self._seen + len(stamps)
            self._wrong += int(np.count_nonzero(np.diff(stamps, prepend=self._stamp) <= 0))
            enough = first or self._seen >= self._settings.out_of_order_from
            self.silent = enough and self._wrong > self._settings.out_of_order * self._seen

    def _watch_delay(self, stamps: Stamps, received: Stamps) -> None:
        """Updates the least delays of windows, which show a clock's drift without the effect of queues."""
        self._window_least = min(self._window_least, 1e-9 * float((received - stamps).min()))
        whole = received[-1] - self._window_start > 1e9 * self._settings.drift_window
        if not self._windows:
            self.delay = self.first_delay = self._window_least
        elif whole:
            self.delay = self._window_least
        if whole:
            self._windows, self._window_start, self._window_least = self._windows + 1, int(received[-1]), np.inf

    def _without_steps(self, stamps: Stamps, received: Stamps) -> Stamps:
        """The stamps corrected for all steps so far, including those among them."""
        advance, passed = np.diff(stamps, prepend=self._stamp), np.diff(received, prepend=self._received)
        if len(advance) >= self._settings.counter_enough:
            self._period = max(int(np.median(advance)), 1)
        back, ahead = advance < -self._jump, advance > max(self._jump, GAP_FACTOR * self._period)
        # clocks drift apart, so the least delay may rise
        self._least += round(self._settings.counter_drift * max(int(received[-1]) - self._received, 0))
        out, start = stamps + self._correction, 0
        for k in (*np.flatnonzero(back | ahead).tolist(), len(stamps)):
            self._least = min(self._least, int((received - out)[start:k].min(initial=self._least)))
            start = k
            if k == len(stamps) or (ahead[k] and received[k] - out[k] > self._least - self._jump):
                continue  # the end, a pause, or an emptying queue: the delay is unchanged
            step = int(advance[k]) - max(int(passed[k]), self._period)
            out[k:] -= step
            self._correction -= step
            self._least = int(received[k] - out[k])
            self.steps, self.furthest = self.steps + 1, max(self.furthest, 1e-9 * abs(step))
        return out

    def notes(self, topic: str) -> Iterator[str]:
        """Yields notes on the corrections, one sentence each."""
        if self.silent:
            yield f"the stamps of {topic} repeat or run back: times of recording are used"
        if self.steps:
            yield (
                f"the clock of {topic} steps {self.steps} time{'s' * (self.steps > 1)}, by up to "
                f"{self.furthest:.3g} s: undone by the times of recording"
            )


class Track:
    """One stream. Samples that are no longer needed are discarded.

    Attributes:
        name, columns: of its values, the name for messages.
        seen, out_of_order: number of samples so far, and of those skipped because their stamps repeat or run back.
        gaps, longest: steps of more than `GAP_FACTOR` periods, and the longest step [ns].
        first, newest: stamps [ns]. period: median step of the beginning [ns].
        clock: repairs the stamps. apart: largest correction so far of this clock relative to the reference's [s].
        stamps, values: of the samples kept, (kept,) [ns] and (kept, columns).
    """

    def __init__(self, name: str, columns: Sequence[str], settings: BagSettings | None = None) -> None:
        self.name, self.columns, self._settings = name, tuple(columns), settings or BagSettings()
        quaternion = IMU_COLUMNS["orientation"]
        self._quaternion = [self.columns.index(q) for q in quaternion] if set(quaternion) <= set(columns) else None
        self.seen = self.out_of_order = self.gaps = self.longest = 0
        self.first = self.newest = 0
        self.period = np.nan
        self.stamps: Stamps = np.empty(0, dtype=np.int64)
        self.values: Array = np.empty((0, len(columns)))
        self.clock = HeaderClock(self._settings)
        self.apart = 0.0
        self._blocks: list[tuple[Stamps, Stamps, Array]] = []
        self._order: dict[tuple[str, ...], list[int]] = {}

    def __len__(self) -> int:
        return self.seen - self.out_of_order

    def __str__(self) -> str:
        """Mean rate and gaps."""
        rate = (len(self) - 1) / (1e-9 * (self.newest - self.first)) if len(self) > 1 else float("nan")
        gaps = f", {self.gaps} gap{'s' * (self.gaps > 1)}, the longest {1e-9 * self.longest:.3f} s" if self.gaps else ""
        return f"{rate:.5g} Hz{gaps}"

    def take(self, samples: Decoded) -> None:
        """Adds samples with their columns in any order; used from the next `settle` on."""
        if (order := self._order.get(samples.columns)) is None:
            order = self._order[samples.columns] = [samples.columns.index(name) for name in self.columns]
        self._blocks.append((samples.stamp, samples.received, samples.values[:, order]))

    def settle(self, reference: Track | None = None) -> None:
        """Processes the samples added since the last call; the clock follows the reference's, if given. Raises
        RecordingError: the stamps are not those of a clock.
        """
        if not self._blocks or (reference is not None and np.isnan(reference.clock.delay)):
            return
        stamps, received, values = (np.concatenate(parts) for parts in zip(*self._blocks, strict=True))
        self._blocks = []
        stamps = self.clock(stamps, received)
        if reference is not None:
            stamps = stamps + round(1e9 * self._behind(reference.clock))
        self.extend(stamps, values)

    def extend(self, stamps: Stamps, values: Array) -> None:
        """Adds samples (samples, columns) at these stamps [ns]. Raises RecordingError: the stamps are not those of a
        clock.
        """
        if not len(stamps):
            return
        before = stamps[0] - 1 if self.seen == 0 else self.newest
        good = stamps > np.maximum.accumulate(np.concatenate([[before], stamps]))[:-1]
        self.seen += len(stamps)
        self.out_of_order += int(np.count_nonzero(~good))
        most, bad = self._settings.out_of_order * self.seen, stamps[~good]
        if self.seen >= self._settings.out_of_order_from and self.out_of_order > most:
            at = f", such as {1e-9 * bad[-1]:.6f} s" if len(bad) else ""
            raise RecordingError(
                f"{self.name}: the stamps of its headers are no clock: {self.out_of_order} of {self.seen} repeat or "
                f"run back{at}"
            )
        stamps, values = stamps[good], values[good]
        if not len(stamps):
            return
        if len(self) == len(stamps):
            self.first = self.newest = int(stamps[0])
        if np.isnan(self.period) and len(stamps) > 1:
            self.period = float(np.median(np.diff(stamps)))
        steps = np.diff(stamps, prepend=self.newest)
        self.gaps += int(np.count_nonzero(steps > GAP_FACTOR * self.period))
        self.longest = max(self.longest, int(steps.max()))
        self.newest = int(stamps[-1])
        self.stamps = np.concatenate([self.stamps, stamps])
        self.values = np.concatenate([self.values, values])

    def _behind(self, other: HeaderClock) -> float:
        """Delay of this clock relative to the other one [s]; 0 if within the scatter of the delays."""
        at_first = self.clock.first_delay - other.first_delay
        behind = self.clock.delay - other.delay
        if abs(at_first) <= self._settings.clocks_apart:
            behind -= at_first
            if abs(behind) <= self._settings.drift:
                return 0.0
        self.apart = max(self.apart, behind, key=abs)
        return float(behind)

    def at(self, stamps: Stamps) -> Array:
        """Values at these stamps, (stamps, columns); NaN where there is none."""
        if not len(self.stamps):
            return np.full((len(stamps), self.values.shape[1]), np.nan)
        own, wanted = (x - self.stamps[0] for x in (self.stamps, stamps))  # small enough for doubles
        out = np.column_stack([np.interp(wanted, own, column, np.nan, np.nan) for column in self.values.T])
        after = np.clip(np.searchsorted(own, wanted), 1, max(len(own) - 1, 1))
        left, right = own[after - 1], own[np.minimum(after, len(own) - 1)]
        between = (left < wanted) & (wanted < right)
        out[between & (right - left > GAP_FACTOR * self.period)] = np.nan
        bridged = np.flatnonzero(between & ~(right - left > GAP_FACTOR * self.period))
        if self._quaternion is not None and len(bridged):
            share = ((wanted - left) / np.maximum(right - left, 1))[bridged, None]
            low, high = (self.values[after[bridged] - back][:, self._quaternion] for back in (1, 0))
            out[bridged[:, None], self._quaternion] = _slerp(low, high, share)
        return out

    def drop(self, count: int) -> None:
        """Discards the oldest samples."""
        self.stamps, self.values = self.stamps[count:], self.values[count:]


class Alignment:
    """Merges streams at the stamps of the first; the settings' `patience` bounds the memory."""

    def __init__(self, tracks: Sequence[Track], settings: BagSettings | None = None) -> None:
        self.reference, self.others = tracks[0], tuple(tracks[1:])
        self._patience = round(1e9 * (settings or BagSettings()).patience)

    def rows(self, *, final: bool = False) -> tuple[Stamps, Array]:
        """The rows completed since the last call: stamps (rows,) [ns], values of all streams (rows, columns). `final`
        if no more samples follow.
        """
        self.reference.settle()
        for track in self.others:
            track.settle(self.reference)
        newest = self.reference.newest
        until = newest if final else max(min((t.newest for t in self.others), default=newest), newest - self._patience)
        count = int(np.searchsorted(self.reference.stamps, until, side="right"))
        stamps = self.reference.stamps[:count]
        values = np.hstack([self.reference.values[:count], *(track.at(stamps) for track in self.others)])
        self.reference.drop(count)
        if count:
            for track in self.others:
                track.drop(max(0, int(np.searchsorted(track.stamps, stamps[-1], side="right")) - 1))
        return stamps, values


def _slerp(low: Array, high: Array, share: Array) -> Array:
    """Interpolates quaternions by a share (n, 1) of the way between two, (n, 4); NaN if either is missing."""
    out = np.full(low.shape, np.nan)
    good = np.isfinite(low).all(axis=1) & np.isfinite(high).all(axis=1) & low.any(axis=1) & high.any(axis=1)
    if good.any():
        from scipy.spatial.transform import Rotation

        start, end = Rotation.from_quat(low[good]), Rotation.from_quat(high[good])
        turned = (start * Rotation.from_rotvec(share[good] * (start.inv() * end).as_rotvec())).as_quat()
        # same sign as the previous sample: a quaternion and its negative are the same rotation
        out[good] = turned * np.where((turned * low[good]).sum(axis=1) < 0, -1.0, 1.0)[:, None]
    return out
