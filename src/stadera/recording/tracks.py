"""Streams of samples that were not taken together, brought to the stamps of one of them.

What a stream says between two of its samples is interpolated linearly, a quaternion along the great circle; at a stamp
of its own it is that sample itself. Across a gap, and before its beginning and after its end, it says nothing.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from stadera.errors import RecordingError
from stadera.recording.sampling import GAP_FACTOR

Array = NDArray[np.float64]
Stamps = NDArray[np.int64]

PATIENCE = 10_000_000_000
"""For so long [ns] a sample waits for the other streams, which bounds the memory."""
MOST_OUT_OF_ORDER = 0.1
"""Share of a stream's stamps that may repeat or run back; above, they are no clock."""
_ENOUGH = 100


class Track:
    """One stream as it comes in; what was already used is let go.

    Attributes:
        name: for messages.
        seen, out_of_order: samples so far, and those left out as their stamps repeat or run back.
        gaps, longest: steps of more than `GAP_FACTOR` periods, and the longest step [ns].
        first, newest: stamps [ns].
        period: median step of the beginning [ns].
    """

    def __init__(self, name: str, width: int, quaternion: slice | None = None) -> None:
        self.name, self._quaternion = name, quaternion
        self.seen = self.out_of_order = self.gaps = self.longest = 0
        self.first = self.newest = 0
        self.period = np.nan
        self.stamps: Stamps = np.empty(0, dtype=np.int64)
        self.values: Array = np.empty((0, width))
        self._waiting: list[tuple[int, Array]] = []

    def __len__(self) -> int:
        return self.seen - self.out_of_order

    @property
    def rate_hz(self) -> float:
        """Mean rate [Hz]; NaN of fewer than two samples."""
        return (len(self) - 1) / (1e-9 * (self.newest - self.first)) if len(self) > 1 else float("nan")

    def add(self, stamp: int, values: Array) -> None:
        """A sample (width,) at its stamp [ns]."""
        self._waiting.append((stamp, values))

    def settle(self) -> None:
        """Take up what was added.

        Raises:
            RecordingError: stamps that are no clock.
        """
        if not self._waiting:
            return
        stamps = np.array([stamp for stamp, _ in self._waiting], dtype=np.int64)
        values = np.array([values for _, values in self._waiting])
        self._waiting = []
        before = stamps[0] - 1 if self.seen == 0 else self.newest
        latest = np.maximum.accumulate(np.concatenate([[before], stamps]))
        good = stamps > latest[:-1]
        self.seen += len(stamps)
        self.out_of_order += int(np.count_nonzero(~good))
        self._judge(stamps[~good])
        stamps = stamps[good]
        if not len(stamps):
            return
        if len(self) == len(stamps):
            self.first = int(stamps[0])
        if np.isnan(self.period) and len(stamps) > 1:
            self.period = float(np.median(np.diff(stamps)))
        steps = np.diff(stamps, prepend=stamps[0] if len(self) == len(stamps) else self.newest)
        self.gaps += int(np.count_nonzero(steps > GAP_FACTOR * self.period))
        self.longest = max(self.longest, int(steps.max()))
        self.newest = int(stamps[-1])
        self.stamps = np.concatenate([self.stamps, stamps])
        self.values = np.concatenate([self.values, values[good]])

    def _judge(self, bad: Stamps) -> None:
        if self.seen >= _ENOUGH and self.out_of_order > MOST_OUT_OF_ORDER * self.seen:
            at = f", such as {1e-9 * bad[-1]:.6f} s" if len(bad) else ""
            raise RecordingError(
                f"{self.name}: the stamps of its headers are no clock: {self.out_of_order} of {self.seen} repeat or "
                f"run back{at}"
            )

    def at(self, stamps: Stamps) -> Array:
        """What it says at these stamps, (stamps, width); NaN where it says nothing."""
        out = np.full((len(stamps), self.values.shape[1]), np.nan)
        if not len(self.stamps):
            return out
        after = np.searchsorted(self.stamps, stamps, side="left")
        own = (after < len(self.stamps)) & (self.stamps[np.minimum(after, len(self.stamps) - 1)] == stamps)
        out[own] = self.values[after[own]]
        inside = np.flatnonzero(~own & (after > 0) & (after < len(self.stamps)))
        left, right = self.stamps[after[inside] - 1], self.stamps[after[inside]]
        narrow = ~(right - left > GAP_FACTOR * self.period)
        inside, left, right = inside[narrow], left[narrow], right[narrow]
        share = ((stamps[inside] - left) / (right - left))[:, None]
        low, high = self.values[after[inside] - 1], self.values[after[inside]]
        out[inside] = low + share * (high - low)
        if self._quaternion is not None and len(inside):
            part = self._quaternion
            out[inside, part] = _turned(low[:, part], high[:, part], share[:, 0])
        return out

    def drop(self, count: int) -> None:
        """Let go of the oldest samples."""
        self.stamps, self.values = self.stamps[count:], self.values[count:]


class Alignment:
    """Streams put together at the stamps of the first.

    Args:
        tracks: the first is the one whose stamps count.
    """

    def __init__(self, tracks: Sequence[Track]) -> None:
        self.reference, self.others = tracks[0], tuple(tracks[1:])

    def rows(self, *, final: bool = False) -> tuple[Stamps, Array]:
        """What can be told since the last call: stamps (rows,) [ns] and the values of all streams (rows, widths).

        Args:
            final: nothing more is to come.
        """
        for track in (self.reference, *self.others):
            track.settle()
        newest = self.reference.newest
        until = newest if final else max(min((t.newest for t in self.others), default=newest), newest - PATIENCE)
        count = int(np.searchsorted(self.reference.stamps, until, side="right"))
        stamps = self.reference.stamps[:count]
        values = np.hstack([self.reference.values[:count], *(track.at(stamps) for track in self.others)])
        self.reference.drop(count)
        if count:
            for track in self.others:
                track.drop(max(0, int(np.searchsorted(track.stamps, stamps[-1], side="right")) - 1))
        return stamps, values


def _turned(low: Array, high: Array, share: Array) -> Array:
    """Quaternions a share of the way from one to the other, (n, 4); NaN where one of them is none."""
    out = np.full(low.shape, np.nan)
    good = np.isfinite(low).all(axis=1) & np.isfinite(high).all(axis=1) & low.any(axis=1) & high.any(axis=1)
    if good.any():
        start, end = Rotation.from_quat(low[good]), Rotation.from_quat(high[good])
        way = (start.inv() * end).as_rotvec()
        turned = (start * Rotation.from_rotvec(share[good, None] * way)).as_quat()
        # on the side of the sphere that the sample before is on
        out[good] = turned * np.where((turned * low[good]).sum(axis=1) < 0, -1.0, 1.0)[:, None]
    return out
