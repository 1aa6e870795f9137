"""Merges streams with different time stamps, at the stamps of one of them.

Between two samples a stream is interpolated linearly, a quaternion along the great circle. A stream has no value in a
gap, before its beginning or after its end.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from stadera.errors import RecordingError
from stadera.logs.bags.clock import HeaderClock
from stadera.logs.bags.container import Sample, SampleBatch
from stadera.logs.bags.settings import DEFAULTS, BagSettings
from stadera.logs.columns import IMU_COLUMNS
from stadera.logs.sampling import GAP_FACTOR
from stadera.types import Array

Stamps = NDArray[np.int64]


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

    def __init__(self, name: str, columns: Sequence[str], settings: BagSettings = DEFAULTS) -> None:
        self.name, self.columns, self._settings = name, tuple(columns), settings
        quaternion = IMU_COLUMNS["orientation"]
        self._quaternion = [self.columns.index(q) for q in quaternion] if set(quaternion) <= set(columns) else None
        self.seen = self.out_of_order = self.gaps = self.longest = 0
        self.first = self.newest = 0
        self.period = np.nan
        self.stamps: Stamps = np.empty(0, dtype=np.int64)
        self.values: Array = np.empty((0, len(columns)))
        self.clock = HeaderClock(settings)
        self.apart = 0.0
        self._waiting: list[tuple[int, int, Array]] = []
        self._blocks: list[tuple[Stamps, Stamps, Array]] = []
        self._order: dict[tuple[str, ...], list[int]] = {}

    def __len__(self) -> int:
        return self.seen - self.out_of_order

    def __str__(self) -> str:
        """Mean rate and gaps."""
        rate = (len(self) - 1) / (1e-9 * (self.newest - self.first)) if len(self) > 1 else float("nan")
        gaps = f", {self.gaps} gap{'s' * (self.gaps > 1)}, the longest {1e-9 * self.longest:.3f} s" if self.gaps else ""
        return f"{rate:.5g} Hz{gaps}"

    def add(self, stamp: int, values: Array, received: int | None = None) -> None:
        """Adds a sample (columns,) with its stamp [ns] and time of recording; used from the next `settle` on."""
        self._waiting.append((stamp, stamp if received is None else received, values))

    def take(self, sample: Sample) -> None:
        """Adds a sample with its columns in any order."""
        self.add(sample.stamp, sample.values[self._places(sample.columns)], sample.received)

    def take_many(self, samples: SampleBatch) -> None:
        """Adds samples with their columns in any order."""
        self._gather()
        self._blocks.append((samples.stamp, samples.received, samples.values[:, self._places(samples.columns)]))

    def _places(self, columns: tuple[str, ...]) -> list[int]:
        if (order := self._order.get(columns)) is None:
            order = self._order[columns] = [columns.index(name) for name in self.columns]
        return order

    def _gather(self) -> None:
        """Makes the samples that were added one by one a block."""
        if self._waiting:
            stamps, received = np.array([times for *times, _ in self._waiting], dtype=np.int64).T
            self._blocks.append((stamps, received, np.array([values for *_, values in self._waiting])))
            self._waiting = []

    def settle(self, reference: Track | None = None) -> None:
        """Processes the samples added since the last call; the clock follows the reference's, if given. Raises
        RecordingError: the stamps are not those of a clock.
        """
        self._gather()
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
        self._check_clock(stamps[~good])
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

    def _check_clock(self, bad: Stamps) -> None:
        enough = self.seen >= self._settings.out_of_order_from
        if enough and self.out_of_order > self._settings.out_of_order * self.seen:
            at = f", such as {1e-9 * bad[-1]:.6f} s" if len(bad) else ""
            raise RecordingError(
                f"{self.name}: the stamps of its headers are no clock: {self.out_of_order} of {self.seen} repeat or "
                f"run back{at}"
            )

    def at(self, stamps: Stamps) -> Array:
        """Values at these stamps, (stamps, columns); NaN where there is none."""
        out = np.full((len(stamps), self.values.shape[1]), np.nan)
        if not len(self.stamps):
            return out
        after = np.searchsorted(self.stamps, stamps, side="left")
        own = (after < len(self.stamps)) & (self.stamps[np.minimum(after, len(self.stamps) - 1)] == stamps)
        out[own] = self.values[after[own]]
        inside = np.flatnonzero(~own & (after > 0) & (after < len(self.stamps)))
        left, right = self.stamps[after[inside] - 1], self.stamps[after[inside]]
        bridged = ~(right - left > GAP_FACTOR * self.period)
        inside, left, right = inside[bridged], left[bridged], right[bridged]
        share = ((stamps[inside] - left) / (right - left))[:, None]
        low, high = self.values[after[inside] - 1], self.values[after[inside]]
        out[inside] = low + share * (high - low)
        if self._quaternion is not None and len(inside):
            part = self._quaternion
            out[inside[:, None], part] = _slerp(low[:, part], high[:, part], share)
        return out

    def drop(self, count: int) -> None:
        """Discards the oldest samples."""
        self.stamps, self.values = self.stamps[count:], self.values[count:]


class Alignment:
    """Merges streams at the stamps of the first; the settings' `patience` bounds the memory."""

    def __init__(self, tracks: Sequence[Track], settings: BagSettings = DEFAULTS) -> None:
        self.reference, self.others = tracks[0], tuple(tracks[1:])
        self._patience = round(1e9 * settings.patience)

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
