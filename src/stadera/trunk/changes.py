"""Detects changes of the load by comparing averages over the latest blocks with the estimate from earlier ones.

A block's residual r = b - A θ̂ - C p̂ with respect to the earlier estimate, resolved along the specific force a, gives
the block's difference in mass and in the first moment across a, for r_force = δm a and r_moment = δh x a::

    δm = a · r_force / a²,      δh = a x r_moment / a²

(The first moment along a, a height, is observable in fast motion only, so no change is sought in it.) Blocks in which a
foot touches down deviate briefly by more than a load does, so an average over n blocks is a Huber mean: values further
from the median than a few times the usual scatter of single blocks are clipped, and no block counts for more than a
usual one (a² would let an impact of ten g count for a hundred blocks). On hard ground such means differ by far from
those of the least squares that gave θ̂, so an average is compared with the Huber mean of all earlier blocks.

The variance of averages under a constant load is taken from the log: the mean square of past averages for each n, given
the present estimates of the joints' errors, plus the effect of model errors when the robot moves as it did not before
(it sets out, turns, stops). Long averages have few samples, so the limit in standard deviations is Student's. A change
is reported when it exceeds both the least change and a number of standard deviations for several blocks in succession,
fewer the longer its average is. A sustained push is reported as a change too: until it ends it cannot be distinguished
from a load.
"""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import dataclass
from functools import lru_cache
from math import exp
from typing import NamedTuple

import numpy as np
from scipy.special import ndtr, stdtrit

from stadera.constants import MEDIAN_OF_CHI2
from stadera.trunk import change_kernel as kernel
from stadera.trunk.error_model import ErrorLayout
from stadera.trunk.joint_errors import Errors
from stadera.trunk.segment import Segment, WeightedRows
from stadera.trunk.settings import ChangeSettings
from stadera.types import Array


@dataclass(frozen=True)
class Jump:
    """A detected change.

    Attributes:
        blocks: the most likely number of blocks since it happened.
        reported: True if it exceeds the least change; a smaller one only restarts the estimate.
        shown: (4,), variance of averages of this length over that expected from model errors, at most 1. Errors that
            averages under a constant load do not show at their prior size have no larger effect on a change either.
    """

    blocks: int
    reported: bool
    shown: Array


class Largest(NamedTuple):
    """The largest deviation: its number of blocks, its standard deviations, whether it is to be reported, and δ."""

    blocks: int
    ratio: float
    reported: bool
    size: Array
    variance: Array


class Spread(NamedTuple):
    """Spread of averages under a constant load, by window.

    Attributes:
        square: (windows, 4) their mean square. usual: (windows, 4) variance due to model errors, not exceeded in nearly
            all of them.
        samples: (windows,) number of independent averages.
    """

    square: Array
    usual: Array
    samples: Array

    def updated(self, more: Spread, prior: float) -> Spread:
        """With more averages; `prior` is the number that the first mean squares count as."""
        before, now = self.samples[:, None], more.samples[:, None]
        worth = prior + before
        return Spread(
            (more.square * now + self.square * worth) / (now + worth),
            (more.usual * now + self.usual * before) / np.maximum(now + before, 1e-300),
            more.samples + self.samples,
        )


class Blocks:
    """Ring buffer of the latest blocks: running sums of the projected rows, and reduced rows.

    Rows are projected on the specific force a, for the differences in mass and in first moment: a · r_force and
    a x r_moment of A, b and C, and the square of a, (4, 10 + 1 + errors + 1). A sum over any range is the difference of
    two running sums. The reduced rows (4, 12) hold A, b - C p and the weight: p is constant over many blocks, so a
    residual costs ten products. Of C, only the columns are kept for which errors are estimated; p is zero elsewhere.
    """

    def __init__(self, most: int, layout: ErrorLayout) -> None:
        self._most, self.end, self.count, self._learnt = most, 0, 0, layout.learnt
        self._rows = np.empty((2 * most, 4, 11 + layout.learnt.stop + 1))
        self._reduced = np.empty((2 * most, 4, 12))
        self.sums = np.zeros((2 * most + 1, 4, 10 + 1 + layout.count + 1))
        self._errors, self._valid = np.zeros(layout.count), 0  # p, and the first row that is reduced with it

    def push(self, rows: WeightedRows, errors: Array) -> None:
        """Appends a block; p are the model errors."""
        if self.end == len(self._rows):
            self._move()
        if errors is not self._errors:
            self._errors, self._valid = errors, self.end
        self._write(rows, self.end)
        self.end, self.count = self.end + 1, min(self.count + 1, self._most)

    def reduced(self, n: int, errors: Array) -> Array:
        """Reduced rows of the last n blocks, (n, 4, 12)."""
        return self.all_reduced(n, errors)[self.end - n : self.end]

    def all_reduced(self, n: int, errors: Array) -> Array:
        """Reduced rows (..., 4, 12), of which those of the n blocks before `end` are valid."""
        if errors is not self._errors:
            self._errors, self._valid = errors, self.end
        if self.end - n < self._valid:
            self._reduce(self.end - n, self._valid)
            self._valid = self.end - n
        return self._reduced

    def _move(self) -> None:
        """Moves the latest rows to the buffer's beginning."""
        kept, end = min(self.count, self._most), self.end
        self._rows[:kept], self._reduced[:kept] = self._rows[end - kept : end], self._reduced[end - kept : end]
        self.sums[: kept + 1] = self.sums[end - kept :]
        self.sums[: kept + 1] -= self.sums[0].copy()
        self.end, self._valid = kept, max(self._valid - (end - kept), 0)

    def _write(self, rows: WeightedRows, at: int) -> None:
        """Writes a block's running sums and reduced rows."""
        columns = np.ascontiguousarray(rows.columns)
        kernel.push(columns, self._errors[self._learnt], self._rows, self._reduced, self.sums, at)

    def _reduce(self, begin: int, end: int) -> None:
        """Reduces rows of a range."""
        kernel.reduce(self._rows, self._reduced, self._errors[self._learnt], begin, end)


class ChangeDetector:
    """Detects changes of the load, block by block.

    Args:
        settings: limits for a change.
        scale: (4,) units of mass and first moments: the robot's mass, and that times the leg's length.
        block: length of a block [s]. layout: places of the model errors.

    Attributes:
        suspected: (4,) [kg, kg·m], difference in mass and first moment over the latest blocks if a change is likely but
            not yet certain. It decays, and is reset when a change is detected.
    """

    def __init__(self, settings: ChangeSettings, scale: Array, block: float, layout: ErrorLayout) -> None:
        self.settings, self._scale, self._block, self._learnt = settings, scale, block, layout.learnt
        self._short = tuple(n for n in settings.windows if n <= settings.pending)
        self._blocks = Blocks(round(settings.memory / block), layout)
        windows = len(settings.windows)
        # up to the last change of the load, and up to now
        self._usual = Spread(np.full((windows, 4), settings.prior**2), np.zeros((windows, 4)), np.zeros(windows))
        self._set(self._usual)
        # single blocks: their number, scatter, Huber mean, largest weight
        self._past_blocks = 0
        self._scatter, self._centre, self._heaviest = np.full(4, settings.prior), np.zeros(4), np.full(4, np.inf)
        self._persists = self._likely = 0
        self._keep = exp(-block / settings.memory)
        self.suspected, self._missed = np.zeros((2, 4))

    def restart(self, kept: int) -> None:
        """Restarts after a change of the load: only the last `kept` blocks belong to the new one."""
        self._persists, self._blocks.count, self._usual = 0, kept, self._spreads
        self.suspected, self._missed = np.zeros((2, 4))

    def look(
        self, rows: WeightedRows, before: Segment, long_before: Segment, errors: Errors, scatter: float, held: bool
    ) -> Jump | None:
        """Returns a change when the last block makes it certain, else None.

        Args:
            rows: the last block.
            before, long_before: the estimate without the last `pending` blocks, and without twice as many.
            errors: mean and standard deviations of the model's errors.
            scatter: κ, the excess scatter of summed rows.
            held: suppress reports, because the model does not fit.
        """
        self._blocks.push(rows, errors.mean)
        best = self._best(before, long_before, errors, scatter)
        self._suspect(best)
        self._persists = (self._persists + 1) * (best.ratio > self.settings.deviations and not held)
        if self._persists < self.settings.persistence(best.blocks):
            return None
        blocks = self._placed(best, before if best.blocks in self._short else long_before, errors)
        return Jump(blocks, best.reported, self._shown(best.blocks))

    def _shown(self, blocks: int) -> Array:
        """`Jump.shown`, with Student's factor for the few averages."""
        at = self.settings.windows.index(blocks)
        square = self._spreads.square[at] / self._student[at] ** 2
        return np.asarray(np.minimum(square / np.maximum(self._spreads.usual[at], 1e-300), 1.0))

    def returned(self, before: Segment, since: Segment, errors: Errors) -> bool:
        """True if the load is again what it was before a change: averages over the latest blocks agree with the
        estimate before, and not with that `since` the change. It was a push, or a foot that was caught.
        """
        n = self.settings.back
        if self._blocks.count < n:
            return False
        spread = self._spreads.square[self.settings.windows.index(n)]

        def ratio(segment: Segment) -> float:
            singles, weights = self._singles(n, segment, errors)
            weights = np.minimum(weights, self._heaviest)
            size = (self._near(singles, _median(singles)) * weights).sum(axis=0) / np.maximum(
                weights.sum(axis=0), 1e-12
            )
            return float((np.abs(size - self._centre) / np.sqrt(spread)).max())

        return ratio(before) < self.settings.suspected and ratio(since) > self.settings.deviations

    def learn(self, before: Segment, errors: Errors) -> None:
        """Updates the spread of averages under a constant load.

        Uses all blocks except the last `pending`, in which a change may still be detected, and the present estimates of
        the model errors. Averages overlap by half, so two count as one sample.
        """
        n = self._blocks.count - self.settings.pending
        if n < 2 * min(self.settings.windows):
            return
        self._set(self._usual.updated(self._past(n, before, errors), self.settings.prior_averages))

    def _set(self, spreads: Spread) -> None:
        """Sets the spreads, with Student's factor of each."""
        self._spreads, limit = spreads, self.settings.deviations
        samples = (spreads.samples + self.settings.prior_averages).astype(int).tolist()
        self._student = np.array([limit / _student(limit, n) for n in samples])

    def _past(self, n: int, before: Segment, errors: Errors) -> Spread:
        """Spread of the averages over the first n blocks alone; also updates what is usual for single blocks."""
        blocks, windows, settings = self._blocks, len(self.settings.windows), self.settings
        square, usual, counts = np.zeros((windows, 4)), np.zeros((windows, 4)), np.zeros(windows, dtype=np.int64)
        usually, self._past_blocks = np.empty((3, 4)), n
        kernel.spreads(
            blocks.all_reduced(blocks.count, errors.mean),
            blocks.sums,
            blocks.end - blocks.count,
            n,
            settings.phases,
            np.array(settings.windows),
            before.mean(errors.mean),
            before.solution,
            errors.std,
            self._scale,
            settings.outlier,
            settings.clipped**2 / MEDIAN_OF_CHI2,
            usually,
            square,
            usual,
            counts,
        )
        self._scatter, self._centre, self._heaviest = usually
        return Spread(square, usual, np.asarray(0.5 * counts, dtype=float))

    def _suspect(self, best: Largest) -> None:
        """Updates `suspected`: a likely change enters the error bars while it lasts. If it persists without being
        detected, it stays in them, since the estimate has absorbed it.
        """
        self._likely = (self._likely + 1) * (best.ratio > self.settings.suspected)
        self._carry(best.size, self._likely >= self.settings.confirmed)

    def _carry(self, size: Array, persists: bool) -> None:
        """Updates `suspected` with the largest deviation δ (4,)."""
        self._missed = self._missed * self._keep
        now = size * self._scale * (self._likely > 0)
        if persists:
            self._missed = np.where(np.abs(now) > np.abs(self._missed), now, self._missed)
        self.suspected = np.where(np.abs(now) > np.abs(self._missed), now, self._missed)

    def _best(self, before: Segment, long_before: Segment, errors: Errors, scatter: float) -> Largest:
        """The deviation of the latest blocks with most standard deviations, from the estimate before short windows and
        from the one before long windows.

        A window's variance is its spread, increased by the part of the present model errors' effect that exceeds the
        usual one. Changes below `least_change` count in long averages only, and update the estimate without a report.
        """
        blocks, settings = self._blocks, self.settings
        full, found = bisect_right(settings.windows, blocks.count), np.empty((3, 4))
        short = full if before.blocks * self._block >= settings.history else 0
        long = full if long_before.blocks * self._block >= settings.history else 0
        ratio = kernel.largest(
            blocks.all_reduced(settings.windows[full - 1] if full else 0, errors.mean),
            blocks.sums,
            blocks.end,
            np.array(settings.windows),
            min(short, len(self._short)),
            long,
            np.ascontiguousarray(before.inverse),
            before.solution,
            np.ascontiguousarray(long_before.inverse),
            long_before.solution,
            errors.mean[self._learnt],
            errors.std,
            self._scale,
            np.array([settings.outlier * self._scatter, self._centre, self._heaviest]),
            self._spreads.square,
            self._spreads.usual,
            self._student,
            scatter,
            np.array([settings.least_change, settings.pending, len(self._short), self._past_blocks]),
            found,
        )
        return Largest(int(found[0, 0]), ratio, bool(found[0, 1]), found[1], found[2])

    def _singles(self, n: int, before: Segment, errors: Errors) -> tuple[Array, Array]:
        """For the last n blocks (n, 4): each one's own difference in units of `scale`, and its weight."""
        reduced = self._blocks.reduced(n, errors.mean)
        left = reduced[..., 10] - reduced[..., :10] @ before.mean(errors.mean)
        weight = reduced[..., 11]
        return left / (np.maximum(weight, 1e-12) * self._scale), weight

    def _near(self, singles: Array, middle: Array) -> Array:
        """Single blocks (n, 4), clipped at Huber's limit from `middle`."""
        limit = self.settings.outlier * self._scatter
        return np.asarray(np.minimum(np.maximum(singles, middle - limit), middle + limit))

    def _placed(self, best: Largest, before: Segment, errors: Errors) -> int:
        """Most likely number of blocks since the change.

        Projected on the change and in standard deviations, blocks before it scatter about 0 and those after it about 1,
        equally. The likelihood of a change at k is largest where Σ_{i≥k} (x_i - 1/2) is.
        """
        n = min(self._blocks.count, best.blocks + self.settings.pending)
        singles, _ = self._singles(n, before, errors)
        along = best.size / best.variance
        x = np.clip((singles - self._centre) @ along / (best.size @ along), -1.0, 2.0) - 0.5
        return int(np.argmax(np.cumsum(x[::-1]))) + 1


def _median(singles: Array) -> Array:
    """Median over blocks, (4,) of (n, 4); of an even number, the upper one of the middle two."""
    return np.asarray(np.partition(singles, len(singles) // 2, axis=0)[len(singles) // 2])


@lru_cache(maxsize=256)
def _student(deviations: float, samples: int) -> float:
    """Quantile of Student's t with the same tail probability as a Gaussian deviation of `deviations`, for a spread
    estimated from `samples` independent samples.
    """
    return float(stdtrit(samples, ndtr(deviations)))
