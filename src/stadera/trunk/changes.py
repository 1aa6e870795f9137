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

from dataclasses import dataclass
from functools import lru_cache
from math import exp
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr, stdtrit

from stadera.constants import MEDIAN_OF_CHI2
from stadera.trunk.error_model import ERRORS, LEARNT
from stadera.trunk.joint_errors import Errors
from stadera.trunk.segment import PROJECTED, Segment, WeightedRows
from stadera.trunk.settings import ChangeSettings
from stadera.types import Array

_DEVIATION = 1.5  # standard deviation over the median absolute deviation, of Gaussian values
_ESTIMATED = slice(11 + LEARNT.start, 11 + LEARNT.stop)  # columns of projected rows, of errors that are estimated


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

    A sum over any range is the difference of two running sums. The reduced rows (4, 12) hold A, b - C p and the weight:
    p is constant over many blocks, so a residual costs ten products. Of C, only the columns are kept for which errors
    are estimated, `LEARNT`; p is zero elsewhere.
    """

    def __init__(self, most: int) -> None:
        self._most, self.end, self.count = most, 0, 0
        self._rows = np.empty((2 * most, 4, _ESTIMATED.stop + 1))
        self._reduced = np.empty((2 * most, 4, 12))
        self.sums = np.zeros((2 * most + 1, 4, PROJECTED))
        self._errors, self._valid = np.zeros(ERRORS), 0  # p, and the first row that is reduced with it

    def push(self, rows: WeightedRows, errors: Array) -> None:
        """Appends a block; p (ERRORS,) are the model errors."""
        if self.end == len(self._rows):
            self._move()
        if errors is not self._errors:
            self._errors, self._valid = errors, self.end
        self._write(rows, self.end)
        self.end, self.count = self.end + 1, min(self.count + 1, self._most)

    def totals(self, begin: NDArray[np.intp], end: NDArray[np.intp]) -> Array:
        """Sums (k, 4, PROJECTED) over ranges given by their numbers of blocks before the latest (k,)."""
        return np.asarray(self.sums[self.end - end] - self.sums[self.end - begin])

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
        projected = rows.projected
        np.add(self.sums[at], projected, out=self.sums[at + 1])
        self._rows[at, :, :-1], self._rows[at, :, -1] = projected[:, : _ESTIMATED.stop], projected[:, -1]
        self._reduce(at, at + 1)

    def _reduce(self, begin: int, end: int) -> None:
        """Reduces rows of a range."""
        rows, out = self._rows[begin:end], self._reduced[begin:end]
        out[..., :10], out[..., 11] = rows[..., :10], rows[..., -1]
        out[..., 10] = rows[..., 10] - rows[..., _ESTIMATED] @ self._errors[LEARNT]


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
        self._blocks = Blocks(round(settings.memory / block))
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
        singles, weights = (x[:n] for x in self._singles(self._blocks.count, before, errors))
        middle, self._heaviest = np.median(singles, axis=0), np.median(weights, axis=0)
        self._scatter = np.maximum(_DEVIATION * np.median(np.abs(singles - middle), axis=0), 1e-6)
        sums = np.zeros((n + 1, 4, 2))
        near = sums[1:]
        near[..., 1] = np.minimum(weights, self._heaviest)
        np.multiply(self._near(singles, middle), near[..., 1], out=near[..., 0])
        np.cumsum(near, axis=0, out=near)
        self._centre = sums[-1, :, 0] / np.maximum(sums[-1, :, 1], 1e-12)
        self._past_blocks, windows = n, self.settings.windows
        limit = self.settings.clipped**2 / MEDIAN_OF_CHI2
        found = Spread(np.zeros((len(windows), 4)), np.zeros((len(windows), 4)), np.zeros(len(windows)))
        for k, m in enumerate(windows):
            first = np.arange(0, n - m, max(m // 2, 1))
            if not len(first):
                continue
            parts = sums[first + m] - sums[first]
            squares = (parts[..., 0] / np.maximum(parts[..., 1], 1e-12) - self._centre) ** 2
            found.square[k] = np.minimum(squares, limit * np.median(squares, axis=0)).mean(axis=0)
            begin = self._blocks.count - first
            expected = self._by_errors(self._blocks.totals(begin, begin - m), before, errors)
            found.usual[k], found.samples[k] = np.quantile(expected, self.settings.phases, axis=0), 0.5 * len(first)
        return found

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
        """The largest deviation of the latest blocks."""
        deviations = self._since(before, errors, self._short) + self._since(long_before, errors, self._long)
        return self._largest(deviations, scatter)

    def _largest(self, found: Deviations, scatter: float) -> Largest:
        """The deviation with most standard deviations.

        A window's variance is its spread, increased by the part of the present model errors' effect that exceeds the
        usual one. Changes below `least_change` count in long averages only, and update the estimate without a report.
        """
        n = len(found.blocks)
        if not n:
            return Largest(0, 0.0, False, np.zeros(4), np.ones(4))
        at = np.searchsorted(self.settings.windows, found.blocks)
        spread = self._spreads.square[at] + np.maximum(found.by_errors - self._spreads.usual[at], 0.0)
        # of the earlier estimate by its rows, or by the spread of as many averages as went into the Huber mean
        share = found.blocks[:, None] / max(self._past_blocks, 1)
        known = np.maximum(scatter * found.before, share * self._spreads.square[at])
        variance = np.maximum(spread, found.own) + known
        size = np.abs(found.size)
        ratios, large = size / np.sqrt(variance), size > self.settings.least_change
        reported = np.asarray(large.any(axis=1))
        ratios[reported] *= large[reported]
        ratio = ratios.max(axis=1) * self._student[at]
        ratio *= np.logical_or(reported, 3 * found.blocks > self.settings.pending)
        k = int(np.argmax(ratio))
        return Largest(int(found.blocks[k]), float(ratio[k]), bool(reported[k]), found.size[k], variance[k])

    def _since(self, before: Segment, errors: Errors, windows: tuple[int, ...]) -> Deviations:
        """Deviations from a segment for each full window; none if the segment is too short."""
        windows = tuple(n for n in windows if n <= self._blocks.count)
        if before.blocks * self._block < self.settings.history or not windows:
            return Deviations.none()
        blocks = np.array(windows)
        known = (before.inverse[:4] ** 2).sum(axis=1) / self._scale**2
        singles, weights = self._singles(windows[-1], before, errors)
        totals = self._blocks.totals(blocks, np.zeros_like(blocks))
        weights = np.minimum(weights, self._heaviest)
        size, own = np.empty((2, len(windows), 4))
        for k, n in enumerate(windows):
            last, weight = singles[-n:], np.maximum(weights[-n:].sum(axis=0), 1e-12)
            size[k] = (self._near(last, _median(last)) * weights[-n:]).sum(axis=0) / weight - self._centre
            own[k] = 1.0 / (weight * self._scale**2)
        return Deviations(blocks, size, self._by_errors(totals, before, errors), own, known + np.zeros_like(size))

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

    def _by_errors(self, totals: Array, before: Segment, errors: Errors) -> Array:
        """(n, 4) variances of averages due to model errors, from summed rows (n, 4, PROJECTED)."""
        flat = totals.reshape(-1, PROJECTED)
        moved = flat[:, 11:-1] - flat[:, :10] @ before.sensitivity
        moved *= errors.std
        square = np.einsum("ne,ne->n", moved, moved).reshape(-1, 4)
        return np.asarray(square / (np.maximum(totals[..., -1], 1e-12) * self._scale) ** 2)

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
