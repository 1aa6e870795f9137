"""Finds changes of the load: averages over the last blocks against all that was known before.

A block's residual r = b - A θ̂ - C p̂ against what was known before, seen along the specific force a, is the block's own
difference of mass and of first moment across a, for r_force = δm a and r_moment = δh x a::

    δm = a · r_force / a²,      δh = a x r_moment / a²

(The first moment along a, a height, shows in fast motions alone: no change is looked for in it.) Blocks of a foot that
touches down deviate for an instant by more than a load, so an average over n blocks is a Huber mean: what lies further
from their median than a few times the usual scatter of single blocks counts as that far.

How much averages vary while nothing changes is taken from the log: the mean square over the past, for each n, and what
errors of the model add to it when the robot does what it did not do before (it sets out, turns, stops). A change is
reported when it exceeds both the least change asked for and so many standard deviations, block after block for a while.
A push that lasts is a change too: nothing tells it from a load until it ends.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from stadera.trunk.considered import Errors
from stadera.trunk.segment import PROJECTED, Segment, WeightedRows
from stadera.trunk.settings import ChangeSettings
from stadera.types import Array

_PHASES = 2.0  # times the mean variance by errors of the model that some phases of a step have
_PRIOR_BLOCKS = 10.0  # that the prior of an average's spread is worth
_LEARNT = 40  # averages seen before they can report a change
_BLOCKS = 6  # of the median that single blocks are compared with
_HALF = 0.5  # of the change: a block nearer to it than to nothing was after it


@dataclass(frozen=True)
class Jump:
    """A change that was found.

    Attributes:
        blocks: how many blocks ago it happened, the likeliest.
        reported: whether it exceeds the least change; a smaller one only makes the estimate begin anew.
    """

    blocks: int
    reported: bool


class Deviation(NamedTuple):
    """An average over the last blocks, in units of `scale`.

    Attributes:
        size: δ (4,). by_errors: (4,) variance by errors of the model.
        own, before: (4,) variances by rows of unit noise, of the average and of what was known before.
    """

    size: Array
    by_errors: Array
    own: Array
    before: Array


class _Largest(NamedTuple):
    """The largest deviation: of how many blocks, how many standard deviations each, whether to be reported, and δ."""

    blocks: int
    ratio: float
    reported: bool
    size: Array
    variance: Array


class _Spread:
    """Mean square of an average's deviation while nothing changes, and of what model errors explain of it."""

    def __init__(self, prior: float, blocks: float) -> None:
        self._square, self._usual, self._weight = np.full(4, prior**2), np.zeros(4), blocks
        self.seen = 0.0

    def learn(self, deviation: Array, expected: Array, memory: float) -> None:
        limited = np.minimum(deviation**2, 9.0 * self._square)
        self._weight = min(self._weight + 1.0, memory)
        self.seen += 1.0
        self._square = self._square + (limited - self._square) / self._weight
        self._usual = self._usual + (expected - self._usual) / min(self.seen, memory)

    def variance(self, expected: Array) -> Array:
        """With what errors of the model cause now beyond what they usually did."""
        return np.asarray(self._square + np.maximum(expected - _PHASES * self._usual, 0.0))


class _Recent:
    """The last blocks' projected rows, in one array without a copy each time."""

    def __init__(self, most: int) -> None:
        self._most, self._rows, self._end, self.count = most, np.empty((4 * most, 4, PROJECTED)), 0, 0

    def push(self, projected: Array) -> None:
        if self._end == len(self._rows):
            kept = min(self.count, self._most)
            self._rows[:kept] = self.last(kept)
            self._end = kept
        self._rows[self._end] = projected
        self._end += 1
        self.count = min(self.count + 1, self._most)

    def last(self, n: int) -> Array:
        """(n, 4, columns)."""
        return self._rows[self._end - n : self._end]


class ChangeDetector:
    """Looks at each block as it comes.

    Args:
        settings: when a change counts.
        scale: (4,) what mass and first moments are measured in: the robot's mass, and that times the leg's length.
        block: length of a block [s].

    Attributes:
        suspected: (4,) [kg, kg·m], by how much mass and first moment of the last blocks differ where that is likely a
            change, but not certain yet; else zero.
    """

    def __init__(self, settings: ChangeSettings, scale: Array, block: float) -> None:
        self.settings, self._scale, self._block = settings, scale, block
        self._short = tuple(n for n in settings.windows if n <= settings.pending)
        self._long = tuple(n for n in settings.windows if n > settings.pending)
        self._spreads = {n: _Spread(settings.prior, _PRIOR_BLOCKS) for n in settings.windows}
        self._scatter = np.full(4, settings.prior)  # of single blocks about the median of a few
        self._compared = _PRIOR_BLOCKS
        self._recent = _Recent(max(*settings.windows, 2 * settings.pending))
        self._waiting: deque[dict[int, Deviation]] = deque()
        self._persists = self._paused = 0
        self.suspected = np.zeros(4)

    def restart(self, kept: int) -> None:
        """The load has changed: what was seen before the last `kept` blocks belongs to another one."""
        self._waiting.clear()
        self._persists = 0
        self._recent.count = kept

    def look(
        self,
        rows: WeightedRows,
        before: Segment,
        long_before: Segment,
        current: Segment,
        errors: Errors,
        scatter: float,
        held: bool,
    ) -> Jump | None:
        """A jump, once the last block makes it certain.

        Args:
            rows: the last block.
            before, long_before: what was known before the last `pending` of them, and before twice as many.
            current: what is known with all of them.
            errors: mean and standard deviations of the model's errors.
            scatter: κ, of sums of rows.
            held: report nothing, for the model does not fit.
        """
        self._recent.push(rows.projected)
        deviations = self._since(before, errors, self._short)
        deviations |= self._since(long_before, errors, self._long)
        best = self._largest(deviations, scatter)
        likely = best.ratio > self.settings.suspected
        self.suspected = best.size * self._scale * likely
        self._paused = (self._paused + 1) * likely
        if self._paused == 0 or self._paused > 2 * self.settings.pending:
            self._compare(current, errors)
            self._learn(self._deviations(current, errors, self.settings.windows))
        self._persists = (self._persists + 1) * (best.ratio > self.settings.deviations and not held)
        if self._persists < self.settings.confirmed:
            return None
        return Jump(self._placed(best, before if best.blocks in self._short else long_before, errors), best.reported)

    def _largest(self, deviations: dict[int, Deviation], scatter: float) -> _Largest:
        """The deviation of most standard deviations, of averages whose spread is known."""
        largest = _Largest(0, 0.0, False, np.zeros(4), np.ones(4))
        for n, deviation in deviations.items():
            if self._spreads[n].seen >= _LEARNT:
                spread = np.maximum(self._spreads[n].variance(deviation.by_errors), scatter * deviation.own)
                variance = spread + scatter * deviation.before
                ratio, reported = self._ratio(n, np.abs(deviation.size), np.sqrt(variance))
                if ratio > largest.ratio:
                    largest = _Largest(n, ratio, reported, deviation.size, variance)
        return largest

    def _ratio(self, n: int, size: Array, std: Array) -> tuple[float, bool]:
        """How many standard deviations, 0 where the change is too small; and whether it is to be reported."""
        large = size > self.settings.least_change
        if large.any():
            return float((size / std)[large].max()), True
        # a smaller one, over long averages alone, is adopted without a report
        return (float((size / std).max()), False) if n > self.settings.pending // 2 else (0.0, False)

    def _since(self, segment: Segment, errors: Errors, windows: tuple[int, ...]) -> dict[int, Deviation]:
        """Deviations from a segment, with its own variance; none while it is too short."""
        if segment.blocks * self._block < self.settings.history:
            return {}
        known = np.diag(segment.inverse @ segment.inverse.T)[:4] / self._scale**2
        found = self._deviations(segment, errors, windows)
        return {n: deviation._replace(before=known) for n, deviation in found.items()}

    def _learn(self, deviations: dict[int, Deviation]) -> None:
        """What averages do while nothing changes, from deviations that are old enough to be sure of that."""
        self._waiting.append(deviations)
        while len(self._waiting) > self.settings.delay:
            for n, old in self._waiting.popleft().items():
                self._spreads[n].learn(old.size, old.by_errors, self.settings.memory / self._block)

    def _singles(self, n: int, before: Segment, errors: Errors) -> tuple[Array, Array, Array]:
        """Of the last n blocks (n, 4): what each says alone, in units of `scale`, and its weight; and their rows."""
        rows = self._recent.last(n)
        left = np.concatenate([-before.mean(errors.mean), [1.0], -errors.mean, [0.0]])
        weight = rows[:, :, -1]
        return (rows @ left) / np.maximum(weight, 1e-12) / self._scale, weight, rows

    def _deviations(self, before: Segment, errors: Errors, windows: tuple[int, ...]) -> dict[int, Deviation]:
        """For each window that is full."""
        windows = tuple(n for n in windows if n <= self._recent.count)
        if not windows:
            return {}
        singles, weights, rows = self._singles(max(windows), before, errors)
        out, K, total, count = {}, before.sensitivity, np.zeros(rows.shape[1:]), 0
        for n in windows:
            total = total + rows[len(rows) - n : len(rows) - count].sum(axis=0)
            count = n
            weight = np.maximum(total[:, -1], 1e-12)
            by_errors = (total[:, 11:-1] - total[:, :10] @ K) / (weight * self._scale)[:, None]
            size = _huber(singles[-n:], weights[-n:], self.settings.outlier * self._scatter)
            expected = ((by_errors * errors.std) ** 2).sum(axis=1)
            out[n] = Deviation(size, expected, 1.0 / (weight * self._scale**2), np.zeros(4))
        return out

    def _compare(self, before: Segment, errors: Errors) -> None:
        """Learns how far single blocks usually lie from the median of a few; of a Gaussian that is 0.8 of its std."""
        if self._recent.count < _BLOCKS:
            return
        singles, _, _ = self._singles(_BLOCKS, before, errors)
        away = np.abs(singles[-1] - np.median(singles, axis=0)) / 0.8
        self._compared = min(self._compared + 1.0, self.settings.memory / self._block)
        self._scatter += (np.minimum(away, 3.0 * self._scatter) - self._scatter) / self._compared

    def _placed(self, best: _Largest, before: Segment, errors: Errors) -> int:
        """How many blocks ago the change most likely happened.

        Seen along the change, in standard deviations, blocks before it lie about 0 and those after it about 1, with
        equal scatter: the likelihood of a change at k is largest where Σ_{i≥k} (x_i - 1/2) is.
        """
        n = min(self._recent.count, best.blocks + self.settings.pending)
        singles, _, _ = self._singles(n, before, errors)
        along = best.size / best.variance
        x = np.clip(singles @ along / (best.size @ along), -1.0, 2.0) - _HALF
        return int(np.argmax(np.cumsum(x[::-1]))) + 1


def _huber(singles: Array, weights: Array, limit: Array) -> Array:
    """Weighted mean (4,) of (n, 4), of which none counts as further from the median than `limit` (4,)."""
    middle = np.median(singles, axis=0)
    near = np.clip(singles, middle - limit, middle + limit)
    return np.asarray((near * weights).sum(axis=0) / np.maximum(weights.sum(axis=0), 1e-12))
