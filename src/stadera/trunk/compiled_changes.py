"""`ChangeDetector` by compiled functions where numba is installed."""

from __future__ import annotations

from bisect import bisect_right
from types import ModuleType

import numpy as np

from stadera.compiled import kernel
from stadera.constants import MEDIAN_OF_CHI2
from stadera.trunk.changes import Blocks, ChangeDetector, Largest, Spread
from stadera.trunk.error_model import LEARNT
from stadera.trunk.joint_errors import Errors
from stadera.trunk.segment import Segment, WeightedRows
from stadera.trunk.settings import ChangeSettings
from stadera.types import Array


def change_detector(settings: ChangeSettings, scale: Array, block: float) -> ChangeDetector:
    """The fastest `ChangeDetector` of this installation."""
    compiled = _compiled()
    return (ChangeDetector if compiled is None else CompiledDetector)(settings, scale, block)


def _compiled() -> ModuleType | None:
    return kernel("stadera.trunk.kernels.changes")


class _CompiledBlocks(Blocks):
    """`Blocks` by compiled functions."""

    def __init__(self, most: int, compiled: ModuleType) -> None:
        super().__init__(most)
        self._compiled = compiled

    def _write(self, rows: WeightedRows, at: int) -> None:
        self._compiled.push(rows.columns, self._errors[LEARNT], self._rows, self._reduced, self.sums, at)

    def _reduce(self, begin: int, end: int) -> None:
        self._compiled.reduce(self._rows, self._reduced, self._errors[LEARNT], begin, end)


class CompiledDetector(ChangeDetector):
    """The same changes as `ChangeDetector`, up to rounding."""

    def __init__(self, settings: ChangeSettings, scale: Array, block: float) -> None:
        super().__init__(settings, scale, block)
        compiled = _compiled()
        assert compiled is not None
        self._compiled = compiled
        self._blocks = _CompiledBlocks(round(settings.memory / block), compiled)
        self._windows = np.array(settings.windows, dtype=np.int64)
        self._limits = np.array([settings.least_change, settings.pending, len(self._short), 0.0])
        self._singles_usually = np.array([settings.outlier * self._scatter, self._centre, self._heaviest])

    def _best(self, before: Segment, long_before: Segment, errors: Errors, scatter: float) -> Largest:
        blocks, settings = self._blocks, self.settings
        full, found = bisect_right(settings.windows, blocks.count), np.empty((3, 4))
        short = full if before.blocks * self._block >= settings.history else 0
        long = full if long_before.blocks * self._block >= settings.history else 0
        ratio = self._compiled.largest(
            blocks.all_reduced(settings.windows[full - 1] if full else 0, errors.mean),
            blocks.sums,
            blocks.end,
            self._windows,
            min(short, len(self._short)),
            long,
            before.inverse,
            before.solution,
            long_before.inverse,
            long_before.solution,
            errors.mean[LEARNT],
            errors.std,
            self._scale,
            self._singles_usually,
            self._spreads.square,
            self._spreads.usual,
            self._student,
            scatter,
            self._limits,
            found,
        )
        return Largest(int(found[0, 0]), ratio, bool(found[0, 1]), found[1], found[2])

    def _carry(self, size: Array, persists: bool) -> None:
        self.suspected = np.empty(4)  # who read the one before keeps it
        likely = self._likely > 0
        self._compiled.undetected(size, self._scale, likely, persists, self._keep, self._missed, self.suspected)

    def _past(self, n: int, before: Segment, errors: Errors) -> Spread:
        blocks, windows = self._blocks, len(self._windows)
        square, usual, counts = np.zeros((windows, 4)), np.zeros((windows, 4)), np.zeros(windows, dtype=np.int64)
        usually, self._past_blocks = np.empty((3, 4)), n
        self._limits[3] = n
        self._compiled.spreads(
            blocks.all_reduced(blocks.count, errors.mean),
            blocks.sums,
            blocks.end - blocks.count,
            n,
            self.settings.phases,
            self._windows,
            before.mean(errors.mean),
            before.solution,
            errors.std,
            self._scale,
            self.settings.outlier,
            self.settings.clipped**2 / MEDIAN_OF_CHI2,
            usually,
            square,
            usual,
            counts,
        )
        self._scatter, self._centre, self._heaviest = usually
        self._singles_usually = usually * [[self.settings.outlier], [1.0], [1.0]]
        return Spread(square, usual, np.asarray(0.5 * counts, dtype=float))
