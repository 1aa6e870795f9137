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
is reported when it exceeds both the least change and a number of standard deviations for several blocks in succession.
A sustained push is reported as a change too: until it ends it cannot be distinguished from a load.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr, stdtrit

from stadera.compiled import compiled, load
from stadera.inertia import skew
from stadera.trunk.error_model import ErrorLayout
from stadera.trunk.joint_errors import Errors
from stadera.trunk.segment import Segment, WeightedRows
from stadera.trunk.settings import ChangeSettings
from stadera.types import Array

Ints = NDArray[np.int64]


class Jump(NamedTuple):
    """A detected change.

    Attributes:
        blocks: the most likely number of blocks since it happened.
        reported: True if it exceeds the least change; a smaller one only restarts the estimate.
    """

    blocks: int
    reported: bool


class Spread(NamedTuple):
    """Spread of averages under a constant load, by window.

    Attributes:
        square: (windows, 4) their mean square. usual: (windows, 4) variance due to model errors, on average.
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


class Usual(NamedTuple):
    """What is usual for single blocks of the past: their number, scatter, Huber mean and largest weight, (4,) each."""

    blocks: int
    scatter: Array
    centre: Array
    heaviest: Array


class Largest(NamedTuple):
    """The deviation with most standard deviations: its number of blocks, standard deviations, δ, its variance, and
    whether it exceeds the least change.
    """

    blocks: int
    ratio: float
    size: Array
    variance: Array
    reported: bool


class Deviations(NamedTuple):
    """Averages over the latest blocks, one for each window, in units of mass and first moment.

    Attributes:
        size: (windows, 4), δ. own: (windows, 4), variance due to noise in them; before: (4,), in the earlier estimate.
    """

    size: Array
    own: Array
    before: Array


class Blocks:
    """Ring buffer of the latest blocks: their rows, projected on the specific force a, and running sums of these.

    Projected rows are a · r_force and a x r_moment of a block's `columns`, and the square of a: (4, columns + 1).
    A sum over any range is the difference of two running sums.
    """

    def __init__(self, most: int, columns: int) -> None:
        self._most, self.end, self.count = most, 0, 0
        self.rows = np.empty((2 * most, 1 + 3, columns + 1))
        self.sums = np.zeros((2 * most + 1, *self.rows.shape[1:]))

    def push(self, rows: WeightedRows) -> None:
        """Appends a block."""
        if self.end == len(self.rows):  # the latest move to the buffer's beginning
            kept, end = self._most, self.end
            self.rows[:kept], self.sums[: kept + 1] = self.rows[end - kept :], self.sums[end - kept :]
            self.sums[: kept + 1] -= self.sums[0].copy()
            self.end = kept
        A, new = rows.columns, self.rows[self.end]
        x, y, z = A.item(4, 3), A.item(5, 1), A.item(3, 2)  # a in the unit of moments, as A[:3, 0] is in that of forces
        new[0, :-1] = A[:3, 0] @ A[:3]
        new[1:, :-1] = skew((x, y, z)) @ A[3:]
        new[0, -1], new[1:, -1] = new[0, 0], x * x + y * y + z * z
        self.sums[self.end + 1] = self.sums[self.end] + new
        self.end, self.count = self.end + 1, min(self.count + 1, self._most)

    def singles(self, n: int, known: Segment, errors: Errors, scale: Array) -> tuple[Array, Array]:
        """Of the last n blocks (n, 4): each one's own difference in units of `scale`, and its weight."""
        rows = self.rows[self.end - n : self.end].reshape(4 * n, -1)
        weight = np.maximum(rows[:, -1], 1e-12).reshape(n, 4)
        residual = (rows[:, :-1] @ known.combination(errors.mean)).reshape(n, 4)
        return residual / (weight * scale), weight

    def by_errors(self, begin: Ints, end: Ints, known: Segment, errors: Errors, scale: Array) -> Array:
        """Variances (k, 4) of averages due to model errors, Σ (C - A K)² σ² of the summed rows over the square of
        their weight; from `begin` to before `end`, (k,), both counted backwards from the last block.
        """
        totals = self.sums[self.end - end] - self.sums[self.end - begin]
        moved = known.by_errors(totals[..., :-1]) * errors.std
        variance = np.einsum("kce,kce->kc", moved, moved)
        return np.asarray(variance / (np.maximum(totals[..., -1], 1e-12) * scale) ** 2)


class ChangeDetector:
    """Detects changes of the load, block by block.

    Args:
        settings: limits for a change.
        scale: (4,) units of mass and first moments: the robot's mass, and that times the leg's length.
        block: length of a block [s]. layout: places of the model errors. places: number of those where a load may be,
            besides the trunk.
    """

    def __init__(
        self, settings: ChangeSettings, scale: Array, block: float, layout: ErrorLayout, places: int = 0
    ) -> None:
        load(huber_means)
        self.settings, self._scale, self._block = settings, scale, block
        self._windows = np.array(settings.windows)
        self._blocks = Blocks(round(settings.memory / block), 11 + layout.count + 10 * places)
        shape = len(settings.windows), len(scale)
        # up to the last change of the load, and up to now
        self._usual = Spread(np.full(shape, settings.prior**2), np.zeros(shape), np.zeros(len(settings.windows)))
        self._spreads = self._usual
        self._past = Usual(0, settings.prior * np.ones_like(scale), np.zeros_like(scale), np.inf * scale)
        self._persists = 0

    def restart(self, kept: int) -> None:
        """Restarts after a change of the load: only the last `kept` blocks belong to the new one."""
        self._persists, self._blocks.count, self._usual = 0, kept, self._spreads

    def dismiss(self) -> None:
        """Forgets a change that was about to be reported, which another place of the load explains."""
        self._persists = 0

    def look(self, rows: WeightedRows, before: Segment, errors: Errors, held: bool) -> Jump | None:
        """Returns a change when the last block makes it certain, else None.

        Args:
            rows: the last block.
            before: the estimate without the last `pending` blocks.
            errors: mean and standard deviations of the model's errors.
            held: suppress reports, because the model does not fit.
        """
        self._blocks.push(rows)
        found, best = self._deviations(before, errors), None
        if found is not None and self._conspicuous(found.size):
            best = self._largest(found, np.zeros_like(found.size))
            if best.ratio > self.settings.deviations:  # model errors only add to the variance
                n = self._windows[: len(found.size)]
                by_model = self._blocks.by_errors(n, np.zeros_like(n), before, errors, self._scale)
                best = self._largest(found, by_model)
        beyond = best is not None and best.ratio > self.settings.deviations and not held
        self._persists = (self._persists + 1) * beyond
        if best is None or self._persists < self.settings.confirmed:
            return None
        return Jump(self._placed(best, before, errors), best.reported)

    def returned(self, before: Segment, since: Segment, errors: Errors) -> bool:
        """True if the load is again what it was before a change: averages over the latest blocks agree with the
        estimate before, and not with that `since` the change. It was a push, or a foot that was caught.
        """
        settings = self.settings
        if self._blocks.count < settings.back:
            return False
        at = settings.windows.index(settings.back)

        def ratio(segment: Segment) -> float:
            means, _ = self._means(self._windows[at : at + 1], segment, errors)
            return float((np.abs(means[0] - self._past.centre) / np.sqrt(self._spreads.square[at])).max())

        return ratio(before) < settings.agreeing and ratio(since) > settings.deviations

    def learn(self, before: Segment, errors: Errors) -> None:
        """Updates the spread of averages under a constant load.

        Uses all blocks except the last `pending`, in which a change may still be detected, and the present estimates of
        the model errors. Averages overlap by half, so two count as one sample.
        """
        count, settings = self._blocks.count, self.settings
        n = count - settings.pending
        if n < 2 * settings.windows[0]:
            return
        singles, weights = (x[:n] for x in self._blocks.singles(count, before, errors, self._scale))
        middle, heaviest = np.median(singles, axis=0), np.median(weights, axis=0)
        scatter = np.maximum(_of_median(np.median(np.abs(singles - middle), axis=0)), 1e-6)
        near, weights = settings.outlier * scatter, np.minimum(weights, heaviest)
        sums = np.zeros((2, n + 1, len(self._scale)))
        np.cumsum(np.clip(singles, middle - near, middle + near) * weights, axis=0, out=sums[0, 1:])
        np.cumsum(weights, axis=0, out=sums[1, 1:])
        centre = sums[0, -1] / sums[1, -1]
        self._past = Usual(n, scatter, centre, heaviest)
        past = Spread(*(np.zeros_like(x) for x in self._usual))
        for k, m in enumerate(settings.windows):
            first = np.arange(0, n - m, m // 2)
            if len(first):
                total, weight = sums[:, first + m] - sums[:, first]
                squares = (total / weight - centre) ** 2
                past.square[k] = squares.mean(axis=0)
                by_model = self._blocks.by_errors(count - first, count - first - m, before, errors, self._scale)
                past.usual[k] = by_model.mean(axis=0)
                past.samples[k] = 0.5 * len(first)
        self._spreads = self._usual.updated(past, settings.prior_averages)

    def _means(self, windows: Ints, known: Segment, errors: Errors) -> tuple[Array, Array]:
        """Huber means of the latest blocks for each window, in units of `scale`, and their weights."""
        singles, weights = self._blocks.singles(windows[-1], known, errors, self._scale)
        usual = self._past
        means, total = np.empty((2, len(windows), len(self._scale)))
        huber_means(singles, weights, windows, self.settings.outlier * usual.scatter, usual.heaviest, means, total)
        return means, total

    def _conspicuous(self, size: Array) -> bool:
        """Whether any deviation (windows, 4) exceeds its limit if nothing adds to the spread of averages."""
        return bool((size**2 > self.settings.deviations**2 * self._spreads.square[: len(size)]).any())

    def _deviations(self, before: Segment, errors: Errors) -> Deviations | None:
        """Deviations of the latest blocks for each full window; None if the earlier estimate is of too few blocks."""
        windows = self._windows[self._windows <= self._blocks.count]
        if before.weight * self._block < self.settings.history or not len(windows):
            return None
        means, weight = self._means(windows, before, errors)
        known = (before.whole.inverse[: len(self._scale)] ** 2).sum(axis=1) / self._scale**2
        return Deviations(means - self._past.centre, 1.0 / (weight * self._scale**2), known)

    def _largest(self, found: Deviations, by_errors: Array) -> Largest:
        """The deviation with most standard deviations.

        A window's variance is its spread, increased by the part of the present model errors' effect (windows, 4) that
        exceeds the usual one. Changes below `least_change` count in long averages only, and update the estimate without
        a report.
        """
        n, settings = len(found.size), self.settings
        windows, square = self._windows[:n], self._spreads.square[:n]
        spread = square + np.maximum(by_errors - self._spreads.usual[:n], 0.0)
        # of the earlier estimate by its rows, or by the spread of as many averages as went into the Huber mean
        known = np.maximum(found.before, windows[:, None] / max(self._past.blocks, 1) * square)
        variance = np.maximum(spread, found.own) + known
        ratios, large = np.abs(found.size) / np.sqrt(variance), np.abs(found.size) > settings.least_change
        reported = np.asarray(large.any(axis=1))
        ratios[reported] *= large[reported]
        samples = (self._spreads.samples[:n] + settings.prior_averages).astype(int).tolist()
        ratio = ratios.max(axis=1) * [settings.deviations / _student(settings.deviations, m) for m in samples]
        ratio *= reported | (3 * windows > settings.pending)
        k = int(np.argmax(ratio))
        return Largest(int(windows[k]), float(ratio[k]), found.size[k], variance[k], bool(reported[k]))

    def _placed(self, best: Largest, before: Segment, errors: Errors) -> int:
        """Most likely number of blocks since the change.

        Projected on the change and in standard deviations, blocks before it scatter about 0 and those after it about 1,
        equally. The likelihood of a change at k is largest where Σ_{i≥k} (x_i - 1/2) is.
        """
        n = min(self._blocks.count, best.blocks + self.settings.pending)
        singles, _ = self._blocks.singles(n, before, errors, self._scale)
        along = best.size / best.variance
        x = np.clip((singles - self._past.centre) @ along / (best.size @ along), -1.0, 2.0) - 0.5
        return int(np.argmax(np.cumsum(x[::-1]))) + 1


@compiled(
    "void(float64[:,::1], float64[:,::1], int64[::1], float64[::1], float64[::1], float64[:,::1], float64[:,::1])"
)
def huber_means(
    singles: Array, weights: Array, windows: Ints, near: Array, heaviest: Array, means: Array, total: Array
) -> None:
    """Writes weighted means of the last blocks' differences, clipped about their median, and their weights.

    Args:
        singles, weights: (n, 4). windows: (k,), numbers of blocks. near, heaviest: (4,), limits of the distance from
            the median and of the weight. means, total: (k, 4), written.
    """
    n, ordered = len(singles), np.empty(len(singles))
    for k in range(len(windows)):
        begin = n - windows[k]
        for c in range(singles.shape[1]):
            for i in range(begin, n):
                value, at = singles[i, c], i - begin
                while at > 0 and ordered[at - 1] > value:
                    ordered[at] = ordered[at - 1]
                    at -= 1
                ordered[at] = value
            centre = ordered[windows[k] // 2]
            value = weight = 0.0
            for i in range(begin, n):
                own = min(weights[i, c], heaviest[c])
                value += min(max(singles[i, c], centre - near[c]), centre + near[c]) * own
                weight += own
            total[k, c] = max(weight, 1e-12)
            means[k, c] = value / total[k, c]


def _of_median(deviation: Array) -> Array:
    """Standard deviation of Gaussian values from their median absolute deviation."""
    return np.asarray(1.5 * deviation)


@lru_cache(maxsize=256)
def _student(deviations: float, samples: int) -> float:
    """Quantile of Student's t with the same tail probability as a Gaussian deviation of `deviations`, for a spread
    estimated from `samples` independent samples.
    """
    return float(stdtrit(samples, ndtr(deviations)))
