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


class Deviation(NamedTuple):
    """Average over the latest blocks, in units of `scale`.

    Attributes:
        size: δ (4,). by_errors: (4,) variance due to model errors.
        own, before: (4,) variances due to white noise, of the average and of the earlier estimate.
    """

    size: Array
    by_errors: Array
    own: Array
    before: Array


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

    def variance(self, expected: Array) -> Array:
        """The variance, increased by the part of the present model errors' effect that exceeds the usual one."""
        return np.asarray(self.square + np.maximum(expected - self.usual, 0.0))


class _Blocks:
    """Ring buffer of the latest blocks' projected rows, contiguous in memory."""

    def __init__(self, most: int) -> None:
        self._most, self._rows, self._end, self.count = most, np.empty((2 * most, 4, PROJECTED)), 0, 0

    def push(self, projected: Array) -> None:
        if self._end == len(self._rows):
            kept = min(self.count, self._most)
            self._rows[:kept] = self.last(kept)
            self._end = kept
        self._rows[self._end] = projected
        self._end += 1
        self.count = min(self.count + 1, self._most)

    def last(self, n: int) -> Array:
        """(n, 4, PROJECTED)."""
        return self._rows[self._end - n : self._end]


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
        self._blocks.push(rows.projected)
        deviations = self._since(before, errors, self._short)
        deviations |= self._since(long_before, errors, self._long)
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
        singles, weights, rows = (x[:n] for x in self._singles(self._blocks.count, before, errors))
        self._scatter = np.maximum(1.5 * np.median(np.abs(singles), axis=0), 1e-6)
        sums = np.cumsum(np.concatenate([np.zeros((1, 4, 2)), self._near(singles, weights)]), axis=0)
        totals = np.cumsum(rows, axis=0)
        self._spreads = {}
        for m in self.settings.windows:
            first = np.arange(0, n - m, max(m // 2, 1))
            if not len(first):
                self._spreads[m] = self._usual[m]
                continue
            parts = sums[first + m] - sums[first]
            squares = (parts[..., 0] / np.maximum(parts[..., 1], 1e-12)) ** 2
            squares = np.minimum(squares, _WILD**2 * np.median(squares, axis=0) / _MEDIAN)
            expected = self._by_errors(totals[first + m] - totals[first], before, errors)
            expected = np.quantile(expected, _MOST, axis=0)
            known, samples = self._usual[m], 0.5 * len(first)
            worth = _PRIOR_SAMPLES + known.samples
            square = (squares.mean(axis=0) * samples + known.square * worth) / (samples + worth)
            usual = (expected * samples + known.usual * known.samples) / (samples + known.samples)
            self._spreads[m] = Spread(square, usual, samples + known.samples)

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

    def _largest(self, deviations: dict[int, Deviation], scatter: float) -> _Largest:
        """The deviation with most standard deviations, among averages whose spread is known."""
        largest, limit = _Largest(0, 0.0, False, np.zeros(4), np.ones(4)), self.settings.deviations
        for n, deviation in deviations.items():
            spread = self._spreads[n]
            own = np.maximum(spread.variance(deviation.by_errors), deviation.own)
            variance = own + scatter * deviation.before
            ratio, reported = self._ratio(n, np.abs(deviation.size), np.sqrt(variance))
            ratio *= limit / _student(limit, int(spread.samples + _PRIOR_SAMPLES))
            if ratio > largest.ratio:
                largest = _Largest(n, ratio, reported, deviation.size, variance)
        return largest

    def _ratio(self, n: int, size: Array, std: Array) -> tuple[float, bool]:
        """Number of standard deviations (0 if the change is too small), and whether the change is to be reported."""
        large = size > self.settings.least_change
        if large.any():
            return float((size / std)[large].max()), True
        # a smaller change, seen in long averages only, updates the estimate without a report
        return (float((size / std).max()), False) if 3 * n > self.settings.pending else (0.0, False)

    def _since(self, before: Segment, errors: Errors, windows: tuple[int, ...]) -> dict[int, Deviation]:
        """Deviations from a segment for each full window; none if the segment is too short."""
        windows = tuple(n for n in windows if n <= self._blocks.count)
        if before.blocks * self._block < self.settings.history or not windows:
            return {}
        known = np.diag(before.inverse @ before.inverse.T)[:4] / self._scale**2
        singles, weights, rows = self._singles(max(windows), before, errors)
        out = {}
        for n in windows:
            total = rows[-n:].sum(axis=0)
            near = self._near(singles[-n:], weights[-n:], _median(singles[-n:])).sum(axis=0)
            weight = np.maximum(total[:, -1], 1e-12)
            by_errors = self._by_errors(total[None], before, errors)[0]
            out[n] = Deviation(near[:, 0] / weight, by_errors, 1.0 / (weight * self._scale**2), known)
        return out

    def _singles(self, n: int, before: Segment, errors: Errors) -> tuple[Array, Array, Array]:
        """For the last n blocks (n, 4): each one's own difference in units of `scale`, its weight, and its rows."""
        rows = self._blocks.last(n)
        left = np.concatenate([-before.mean(errors.mean), [1.0], -errors.mean, [0.0]])
        weight = rows[:, :, -1]
        return (rows @ left) / np.maximum(weight, 1e-12) / self._scale, weight, rows

    def _near(self, singles: Array, weights: Array, middle: Array | float = 0.0) -> Array:
        """(n, 4, 2): weighted blocks (n, 4), clipped at Huber's limit from `middle`, and their weights."""
        limit = self.settings.outlier * self._scatter
        return np.stack([np.clip(singles, middle - limit, middle + limit) * weights, weights], axis=-1)

    def _by_errors(self, totals: Array, before: Segment, errors: Errors) -> Array:
        """(n, 4) variances of averages due to model errors, from summed rows (n, 4, PROJECTED)."""
        share = totals / (np.maximum(totals[..., -1], 1e-12) * self._scale)[..., None]
        moved = (share[..., 11:-1] - share[..., :10] @ before.sensitivity) * errors.std
        return np.asarray((moved**2).sum(axis=-1))

    def _placed(self, best: _Largest, before: Segment, errors: Errors) -> int:
        """Most likely number of blocks since the change.

        Projected on the change and in standard deviations, blocks before it scatter about 0 and those after it about 1,
        equally. The likelihood of a change at k is largest where Σ_{i≥k} (x_i - 1/2) is.
        """
        n = min(self._blocks.count, best.blocks + self.settings.pending)
        singles, _, _ = self._singles(n, before, errors)
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
