"""Detects changes of the load by comparing averages over the latest blocks with the estimate from earlier ones.

A block's residual r = b - A θ̂ - C p̂ with respect to the earlier estimate, resolved along the specific force a, gives
the block's difference in mass and in the first moment across a, for r_force = δm a and r_moment = δh x a::

    δm = a · r_force / a²,      δh = a x r_moment / a²

(The first moment along a, a height, is observable in fast motion only, so no change is sought in it.) Blocks in which a
foot touches down deviate briefly by more than a load does, so an average over n blocks is a Huber mean: values further
from the median than a few times the usual scatter of single blocks are clipped.

The variance of averages under a constant load is taken from the log: the mean square of past averages for each n, given
the present estimates of the joints' errors, plus the effect of model errors when the robot moves as it did not before
(it sets out, turns, stops). Long averages have few samples, so the limit in standard deviations is Student's. A change
is reported when it exceeds both the least change and a number of standard deviations for several blocks in succession.
A sustained push is reported as a change too: until it ends it cannot be distinguished from a load.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from math import exp
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr, stdtrit

from stadera.trunk.considered import Errors
from stadera.trunk.segment import PROJECTED, Segment, WeightedRows
from stadera.trunk.settings import ChangeSettings
from stadera.types import Array

_MOST = 0.9  # share of the phases of a step in which model errors are at most `Spread.usual`
_PRIOR_SAMPLES = 1.0  # independent averages that the prior of their spread counts as
_WILD = 3.0  # standard deviations at which an average is clipped
_MEDIAN = 0.455  # of χ² with one degree of freedom
_HALF = 0.5  # of the change: a block beyond it is assigned to the time after the change


@dataclass(frozen=True)
class Jump:
    """A detected change.

    Attributes:
        blocks: the most likely number of blocks since it happened.
        reported: True if it exceeds the least change; a smaller one only restarts the estimate.
    """

    blocks: int
    reported: bool


class Deviations(NamedTuple):
    """Averages over the latest blocks, one for each window, in units of `scale`.

    Attributes:
        blocks: (windows,) number of blocks.
        size: δ (windows, 4). by_errors: (windows, 4) variances due to model errors.
        own, before: (windows, 4) variances due to white noise, of the averages and of the earlier estimate.
    """

    blocks: NDArray[np.intp]
    size: Array
    by_errors: Array
    own: Array
    before: Array

    @classmethod
    def none(cls) -> Deviations:
        """No windows."""
        return cls(np.zeros(0, dtype=np.intp), *np.zeros((4, 0, 4)))

    def __add__(self, others: object) -> Deviations:
        """These and the deviations of longer windows."""
        assert isinstance(others, Deviations)
        if not len(others.blocks):
            return self
        return Deviations(*(np.concatenate(pair) for pair in zip(self, others, strict=True)))


class _Largest(NamedTuple):
    """The largest deviation: its number of blocks, its standard deviations, whether it is to be reported, and δ."""

    blocks: int
    ratio: float
    reported: bool
    size: Array
    variance: Array


class Spread(NamedTuple):
    """Spread of averages over a number of blocks under a constant load.

    Attributes:
        square: (4,) their mean square. usual: (4,) variance due to model errors, not exceeded in nearly all of them.
        samples: number of independent averages.
    """

    square: Array
    usual: Array
    samples: float


class _Blocks:
    """Ring buffer of the latest blocks' projected rows, contiguous in memory, with running sums and reduced rows.

    A sum over any range is the difference of two running sums. The reduced rows (4, 12) hold A, b - C p and the weight:
    p is constant over many blocks, so a residual costs ten products instead of 157.
    """

    def __init__(self, most: int) -> None:
        self._most, self._end, self.count = most, 0, 0
        self._rows = np.empty((2 * most, 4, PROJECTED))
        self._reduced = np.empty((2 * most, 4, 12))
        self._sums = np.zeros((2 * most + 1, 4, PROJECTED))
        self._errors = np.zeros(PROJECTED - 11)

    def push(self, projected: Array, errors: Array) -> None:
        """Appends a block; p (ERRORS,) are the model errors."""
        if self._end == len(self._rows):
            kept = min(self.count, self._most)
            self._rows[:kept], self._reduced[:kept] = self.last(kept), self._reduced[self._end - kept :]
            self._end = kept
            np.cumsum(self._rows[:kept], axis=0, out=self._sums[1 : kept + 1])
        at = self._end
        self._rows[at] = projected
        self._end, self.count = at + 1, min(self.count + 1, self._most)
        np.add(self._sums[at], projected, out=self._sums[at + 1])
        self._reduce(at, errors)

    def last(self, n: int) -> Array:
        """(n, 4, PROJECTED)."""
        return self._rows[self._end - n : self._end]

    def totals(self, begin: NDArray[np.intp], end: NDArray[np.intp]) -> Array:
        """Sums (k, 4, PROJECTED) over ranges given by their numbers of blocks before the latest (k,)."""
        return np.asarray(self._sums[self._end - end] - self._sums[self._end - begin])

    def reduced(self, n: int, errors: Array) -> Array:
        """Reduced rows of the last n blocks, (n, 4, 12)."""
        self._reduce(self._end, errors)
        return self._reduced[self._end - n : self._end]

    def _reduce(self, start: int, errors: Array) -> None:
        """Reduces rows from `start` on, or all of them if p has changed."""
        if errors is not self._errors:
            start, self._errors, left = max(self._end - self._most, 0), errors, np.concatenate([[1.0], -errors])
            self._left = left
        rows, out = self._rows[start : self._end], self._reduced[start : self._end]
        if len(rows):
            out[..., :10], out[..., 11] = rows[..., :10], rows[..., -1]
            np.matmul(rows[..., 10:-1], self._left, out=out[..., 10])


class ChangeDetector:
    """Detects changes of the load, block by block.

    Args:
        settings: limits for a change.
        scale: (4,) units of mass and first moments: the robot's mass, and that times the leg's length.
        block: length of a block [s].

    Attributes:
        suspected: (4,) [kg, kg·m], difference in mass and first moment over the latest blocks if a change is likely but
            not yet certain. It decays, and is reset when a change is detected.
    """

    def __init__(self, settings: ChangeSettings, scale: Array, block: float) -> None:
        self.settings, self._scale, self._block = settings, scale, block
        self._short = tuple(n for n in settings.windows if n <= settings.pending)
        self._long = tuple(n for n in settings.windows if n > settings.pending)
        self._blocks = _Blocks(round(settings.memory / block))
        nothing = Spread(np.full(4, settings.prior**2), np.zeros(4), 0.0)
        self._usual = dict.fromkeys(settings.windows, nothing)  # up to the last change of the load
        self._spreads = self._usual
        self._gather()
        self._scatter = np.full(4, settings.prior)  # of single blocks
        self._persists = self._likely = 0
        self.suspected = self._missed = np.zeros(4)

    def restart(self, kept: int) -> None:
        """Restarts after a change of the load: only the last `kept` blocks belong to the new one."""
        self._persists, self._blocks.count, self._usual = 0, kept, self._spreads
        self.suspected = self._missed = np.zeros(4)

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
        self._blocks.push(rows.projected, errors.mean)
        deviations = self._since(before, errors, self._short) + self._since(long_before, errors, self._long)
        best = self._largest(deviations, scatter)
        self._suspect(best)
        self._persists = (self._persists + 1) * (best.ratio > self.settings.deviations and not held)
        if self._persists < self.settings.confirmed:
            return None
        return Jump(self._placed(best, before if best.blocks in self._short else long_before, errors), best.reported)

    def learn(self, before: Segment, errors: Errors) -> None:
        """Updates the spread of averages under a constant load.

        Uses all blocks except the last `pending`, in which a change may still be detected, and the present estimates of
        the model errors. Averages overlap by half, so two count as one sample.
        """
        n = self._blocks.count - self.settings.pending
        if n < 2 * min(self.settings.windows):
            return
        singles, weights = (x[:n] for x in self._singles(self._blocks.count, before, errors))
        self._scatter = np.maximum(1.5 * np.median(np.abs(singles), axis=0), 1e-6)
        sums = np.zeros((n + 1, 4, 2))
        near = sums[1:]
        np.multiply(self._near(singles), weights, out=near[..., 0])
        near[..., 1] = weights
        np.cumsum(near, axis=0, out=near)
        spreads = {}
        for m in self.settings.windows:
            first = np.arange(0, n - m, max(m // 2, 1))
            if not len(first):
                spreads[m] = self._usual[m]
                continue
            parts = sums[first + m] - sums[first]
            squares = (parts[..., 0] / np.maximum(parts[..., 1], 1e-12)) ** 2
            squares = np.minimum(squares, _WILD**2 * np.median(squares, axis=0) / _MEDIAN)
            begin = self._blocks.count - first
            expected = self._by_errors(self._blocks.totals(begin, begin - m), before, errors)
            expected = np.quantile(expected, _MOST, axis=0)
            known, samples = self._usual[m], 0.5 * len(first)
            worth = _PRIOR_SAMPLES + known.samples
            square = (squares.mean(axis=0) * samples + known.square * worth) / (samples + worth)
            usual = (expected * samples + known.usual * known.samples) / (samples + known.samples)
            spreads[m] = Spread(square, usual, samples + known.samples)
        self._spreads = spreads
        self._gather()

    def _gather(self) -> None:
        """Stacks the spreads by window, with Student's factor of each."""
        spreads = list(self._spreads.values())
        self._square, self._expected = (np.array([s[k] for s in spreads]) for k in (0, 1))
        limit = self.settings.deviations
        self._student = np.array([limit / _student(limit, int(s.samples + _PRIOR_SAMPLES)) for s in spreads])

    def _suspect(self, best: _Largest) -> None:
        """Updates `suspected`: a likely change enters the error bars while it lasts. If it persists without being
        detected, it stays in them, since the estimate has absorbed it.
        """
        self._likely = (self._likely + 1) * (best.ratio > self.settings.suspected)
        self._missed = self._missed * exp(-self._block / self.settings.memory)
        now = best.size * self._scale * (self._likely > 0)
        if self._likely >= self.settings.confirmed:
            self._missed = np.where(np.abs(now) > np.abs(self._missed), now, self._missed)
        self.suspected = np.where(np.abs(now) > np.abs(self._missed), now, self._missed)

    def _largest(self, found: Deviations, scatter: float) -> _Largest:
        """The deviation with most standard deviations.

        A window's variance is its spread, increased by the part of the present model errors' effect that exceeds the
        usual one. Changes below `least_change` count in long averages only, and update the estimate without a report.
        """
        n = len(found.blocks)
        if not n:
            return _Largest(0, 0.0, False, np.zeros(4), np.ones(4))
        at = np.searchsorted(self.settings.windows, found.blocks)
        spread = self._square[at] + np.maximum(found.by_errors - self._expected[at], 0.0)
        variance = np.maximum(spread, found.own) + scatter * found.before
        size = np.abs(found.size)
        ratios, large = size / np.sqrt(variance), size > self.settings.least_change
        reported = np.asarray(large.any(axis=1))
        ratios[reported] *= large[reported]
        ratio = ratios.max(axis=1) * self._student[at]
        ratio *= np.logical_or(reported, 3 * found.blocks > self.settings.pending)
        k = int(np.argmax(ratio))
        return _Largest(int(found.blocks[k]), float(ratio[k]), bool(reported[k]), found.size[k], variance[k])

    def _since(self, before: Segment, errors: Errors, windows: tuple[int, ...]) -> Deviations:
        """Deviations from a segment for each full window; none if the segment is too short."""
        windows = tuple(n for n in windows if n <= self._blocks.count)
        if before.blocks * self._block < self.settings.history or not windows:
            return Deviations.none()
        blocks = np.array(windows)
        known = (before.inverse[:4] ** 2).sum(axis=1) / self._scale**2
        singles, weights = self._singles(windows[-1], before, errors)
        totals = self._blocks.totals(blocks, np.zeros_like(blocks))
        near = np.empty((len(windows), 4))
        for k, n in enumerate(windows):
            last = singles[-n:]
            near[k] = (self._near(last, _median(last)) * weights[-n:]).sum(axis=0)
        weight = np.maximum(totals[..., -1], 1e-12)
        by_errors = self._by_errors(totals, before, errors)
        return Deviations(
            blocks, near / weight, by_errors, 1.0 / (weight * self._scale**2), known + np.zeros_like(near)
        )

    def _singles(self, n: int, before: Segment, errors: Errors) -> tuple[Array, Array]:
        """For the last n blocks (n, 4): each one's own difference in units of `scale`, and its weight."""
        reduced = self._blocks.reduced(n, errors.mean)
        left = reduced[..., 10] - reduced[..., :10] @ before.mean(errors.mean)
        weight = reduced[..., 11]
        return left / (np.maximum(weight, 1e-12) * self._scale), weight

    def _near(self, singles: Array, middle: Array | float = 0.0) -> Array:
        """Single blocks (n, 4), clipped at Huber's limit from `middle`."""
        limit = self.settings.outlier * self._scatter
        return np.asarray(np.minimum(np.maximum(singles, middle - limit), middle + limit))

    def _by_errors(self, totals: Array, before: Segment, errors: Errors) -> Array:
        """(n, 4) variances of averages due to model errors, from summed rows (n, 4, PROJECTED)."""
        flat = totals.reshape(-1, PROJECTED)
        moved = flat[:, 11:-1] - flat[:, :10] @ before.sensitivity
        moved *= errors.std
        square = np.einsum("ne,ne->n", moved, moved).reshape(-1, 4)
        return np.asarray(square / (np.maximum(totals[..., -1], 1e-12) * self._scale) ** 2)

    def _placed(self, best: _Largest, before: Segment, errors: Errors) -> int:
        """Most likely number of blocks since the change.

        Projected on the change and in standard deviations, blocks before it scatter about 0 and those after it about 1,
        equally. The likelihood of a change at k is largest where Σ_{i≥k} (x_i - 1/2) is.
        """
        n = min(self._blocks.count, best.blocks + self.settings.pending)
        singles, _ = self._singles(n, before, errors)
        along = best.size / best.variance
        x = np.clip(singles @ along / (best.size @ along), -1.0, 2.0) - _HALF
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
