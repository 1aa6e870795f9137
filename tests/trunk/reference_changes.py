"""Averages over the latest blocks, in numpy: what the compiled detector of changes is compared with."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stadera.constants import MEDIAN_OF_CHI2
from stadera.trunk.changes import ChangeDetector, Largest, Spread, _median
from stadera.trunk.joint_errors import Errors
from stadera.trunk.segment import Segment
from stadera.types import Array

_DEVIATION = 1.5


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


class ReferenceDetector(ChangeDetector):
    """The same changes, by numpy."""

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
            expected = self._by_errors(self._totals(begin, begin - m), before, errors)
            found.usual[k], found.samples[k] = np.quantile(expected, self.settings.phases, axis=0), 0.5 * len(first)
        return found

    def _best(self, before: Segment, long_before: Segment, errors: Errors, scatter: float) -> Largest:
        """The largest deviation of the latest blocks."""
        deviations = self._since(before, errors, self._short) + self._since(
            long_before, errors, self.settings.windows[len(self._short) :]
        )
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
        totals = self._totals(blocks, np.zeros_like(blocks))
        weights = np.minimum(weights, self._heaviest)
        size, own = np.empty((2, len(windows), 4))
        for k, n in enumerate(windows):
            last, weight = singles[-n:], np.maximum(weights[-n:].sum(axis=0), 1e-12)
            size[k] = (self._near(last, _median(last)) * weights[-n:]).sum(axis=0) / weight - self._centre
            own[k] = 1.0 / (weight * self._scale**2)
        return Deviations(blocks, size, self._by_errors(totals, before, errors), own, known + np.zeros_like(size))

    def _by_errors(self, totals: Array, before: Segment, errors: Errors) -> Array:
        """(n, 4) variances of averages due to model errors, from summed rows (n, 4, flat_width)."""
        flat = totals.reshape(-1, totals.shape[-1])
        moved = flat[:, 11:-1] - flat[:, :10] @ before.sensitivity
        moved *= errors.std
        square = np.einsum("ne,ne->n", moved, moved).reshape(-1, 4)
        return np.asarray(square / (np.maximum(totals[..., -1], 1e-12) * self._scale) ** 2)

    def _totals(self, begin: NDArray[np.intp], end: NDArray[np.intp]) -> Array:
        blocks = self._blocks
        return np.asarray(blocks.sums[blocks.end - end] - blocks.sums[blocks.end - begin])
