"""Sampling of a log: its rate, evenness and gaps; and resampling to an even grid."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from stadera.errors import RecordingError
from stadera.types import Array, Bools

HEAD = 4096
"""Samples at the beginning of a log that determine its rate and evenness, whether read whole or in chunks."""
GAP_FACTOR = 5.0
"""A step of more than this many periods is a gap: a cubic interpolates three or four samples of a motion that is slow
compared with the sampling rate; longer gaps would contain invented data.
"""


def usual_step(time: Array, burst: int = 25) -> float:
    """Time between two samples (samples,) in the long run [s]: the median of the means over so many successive steps,
    more than arrive at once (`burst`).

    Samples that are stamped as they arrive, some at once and then none for a while, were taken at this period; no gap
    stretches it.
    """
    among = min(burst, len(time) - 1)
    return float(np.median(time[among:] - time[:-among])) / among


@dataclass(frozen=True)
class Sampling:
    """Sampling of a log."""

    period: float  # mean step [s], over the even steps of an even log, or over all steps except gaps of an uneven one
    even: bool  # True if it can be filtered without interpolation
    tolerance: float = 0.01  # deviation of a step of an even log, as a share of the period

    @property
    def rate_hz(self) -> float:
        """Sampling rate [Hz]."""
        return 1.0 / self.period

    def breaks(self, steps: Array) -> Bools:
        """Steps that split the log."""
        if self.even:
            return np.asarray(np.abs(steps - self.period) > self.tolerance * self.period)
        return np.asarray(steps > GAP_FACTOR * self.period)


def sampling_of(time: Array, source: str = "recording", even_share: float = 0.999) -> Sampling:
    """Determines the sampling of a log from its first HEAD time stamps; RecordingError for fewer than two.

    Args:
        time: (samples,) [s], increasing. source: of the log, for messages.
        even_share: share of even steps in an even log; the few others split it instead of causing interpolation.
    """
    steps = np.diff(time[:HEAD])
    if not len(steps):
        raise RecordingError(f"{source}: too few samples: {len(time)}, at least 2 are needed")
    median = float(np.median(steps))
    alike = np.abs(steps - median) <= Sampling.tolerance * median
    even = float(alike.mean()) >= even_share
    return Sampling(float(steps[alike if even else steps <= GAP_FACTOR * usual_step(time[:HEAD])].mean()), even)


@dataclass(frozen=True, eq=False)
class Block:
    """A stretch of signals without a gap: a segment, or a part of one."""

    time: Array  # (samples,) [s]
    values: Array  # (channels, samples), each signal contiguous in memory
    # start, end: whether it is the first, and the last, part of its segment
    start: bool
    end: bool

    def after(self, earlier: Block | None) -> Block:
        """This block, preceded by samples kept from an earlier one of the same segment."""
        if earlier is None or self.start:
            return self
        time = np.concatenate([earlier.time, self.time])
        return Block(time, np.concatenate([earlier.values, self.values], axis=1), earlier.start, self.end)

    def last(self, count: int) -> Block:
        """Its last samples, as a part in the midst of its segment."""
        return Block(self.time[-count:], self.values[:, -count:], start=False, end=False)


def segments(stacks: Iterable[tuple[Array, Array]], sampling: Sampling) -> Iterator[Block]:
    """Yields blocks from consecutive (time, values) stacks, split at the breaks of `sampling`.

    The last block of a stack is held back until the next stack shows whether its segment continues.
    """
    held: Block | None = None
    for time, values in stacks:
        last = time[0] - sampling.period if held is None else held.time[-1]
        cut = sampling.breaks(np.diff(time, prepend=last))
        edges = np.unique(np.concatenate([[0], np.flatnonzero(cut), [len(time)]]))
        for first, after in pairwise(edges.tolist()):
            start = held is None or bool(cut[first])
            if held is not None:
                yield replace(held, end=start)
            held = Block(time[first:after], values[:, first:after], start, end=False)
    if held is not None:
        yield replace(held, end=True)


def resampled(blocks: Iterable[Block], period: float) -> Iterator[Block]:
    """Resamples every segment to an even grid that starts with it, by cubic Hermite interpolation.

    Slopes are second-order differences on the uneven stamps (Catmull-Rom). The error of linear interpolation is ddq
    T²/8, 1e-4 rad at 40 rad/s² and 200 Hz, as much as an encoder's noise; that of this one is below 1e-5 of the
    amplitude. Unlike a spline's, a value depends on four samples only, so chunks give the same result as the whole log.
    """
    from scipy import interpolate

    kept: Block | None = None
    origin, count = 0.0, 0
    for fresh in blocks:
        if fresh.start:
            kept, origin, count = None, float(fresh.time[0]), 0
        block = fresh.after(kept)
        time = block.time
        first = 0 if block.start else 1
        last = len(time) - 1 if block.end else len(time) - 2  # the last sample's slope needs the next sample
        if block.start and block.end and len(time) == 1:
            yield block
            continue
        if last <= first:
            kept = block
            continue
        slopes = np.gradient(block.values, time, axis=1)
        steps = int(np.floor((time[last] - origin) / period + 1e-9)) + 1
        grid: Array = origin + period * np.arange(count, steps, dtype=np.float64)
        curve = interpolate.CubicHermiteSpline(time, block.values, slopes, axis=1)
        yield Block(grid, np.ascontiguousarray(curve(grid)), start=count == 0, end=block.end)
        kept, count = block.last(3), steps


def windows(blocks: Iterable[Block], half: int) -> Iterator[Block]:
    """Yields blocks long enough for a kernel of `half` samples on each side.

    Each overlaps the previous one of its segment by 2 half samples, so that correlating every block where the window is
    complete yields each sample once. Segments shorter than a window are skipped.
    """
    kept: Block | None = None
    for fresh in blocks:
        block = fresh.after(kept)
        samples = len(block.time)
        kept = block
        if samples > 2 * half:
            yield block
            kept = block.last(2 * half) if half else None
