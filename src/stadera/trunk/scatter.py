"""Scatter of the rows: outlying single blocks, and sums that vary more than their weights predict."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from stadera.trunk.segment import Segment, WeightedRows
from stadera.trunk.settings import OutlierSettings
from stadera.types import Array


def enough_rows(known: Segment, usual: float, settings: OutlierSettings) -> bool:
    """True if the estimate has enough rows to evaluate a block with; `usual` as in `OddBlocks`, NaN before any."""
    return known.blocks >= (settings.cluster if np.isnan(usual) else settings.afresh)


class OddBlocks:
    """Down-weights blocks that fit far worse than usual, except many in succession, which indicate a change of the
    load.

    Attributes:
        usual: squared residual of usual blocks. odd: number of successive odd blocks.
    """

    def __init__(self, settings: OutlierSettings) -> None:
        self._settings = settings
        self.usual, self.odd = np.nan, 0

    def limited(self, rows: WeightedRows, known: Segment, errors: Array) -> WeightedRows:
        """Returns the block, weighted, given the estimate and model errors p̂ (ERRORS,)."""
        if not enough_rows(known, self.usual, self._settings):
            return rows
        residual = rows.residual(known.mean(errors), errors)
        square = float(residual @ residual)
        if np.isnan(self.usual):
            self.usual = square
        limit = self._settings.outlier * max(self.usual, self._settings.least_usual)
        self.usual += 0.01 * (min(square, 4.0 * self.usual) - self.usual)
        self.odd = self.odd + 1 if square > limit else 0
        if not 0 < self.odd <= self._settings.successive:
            return rows
        weight = np.sqrt(limit / square)
        return replace(rows, columns=weight * rows.columns, white=weight**2 * rows.white)


class Scatter:
    """κ: sums of residuals over a cluster of blocks, compared with those of independent rows of unit noise.

    Args:
        wide: (4,) [kg, kg·m], prior of mass and first moment.
        most: number of blocks in memory.

    Attributes:
        value: κ.
        sum, normal, summed: Σ Aᵀ r (4,), Σ Aᵀ A (4, 4) and number of blocks of the unfinished sum.
    """

    def __init__(self, wide: Array, most: float, settings: OutlierSettings) -> None:
        self._prior, self._most, self.settings = np.diag(1.0 / wide**2), most / settings.cluster, settings
        self.value, self._clusters = 1.0, settings.prior_clusters
        self.restart()

    def restart(self) -> None:
        """Discards the unfinished sum after a change of the load."""
        self.sum, self.normal, self.summed = np.zeros(4), np.zeros((4, 4)), 0

    def count(self, rows: WeightedRows, known: Segment, errors: Array) -> None:
        """Adds a block, given the estimate and model errors p̂ (ERRORS,)."""
        if known.blocks < self.settings.cluster:
            return
        shown = rows.columns[:, :4].T
        self.sum += shown @ rows.residual(known.mean(errors), errors)
        self.normal += shown @ shown.T
        self.summed += 1
        self.close()

    def close(self) -> None:
        """Updates κ once the sum is complete."""
        if self.summed < self.settings.cluster:
            return
        ratio = float(self.sum @ np.linalg.solve(self.normal + self._prior, self.sum)) / 4.0
        self._clusters = min(self._clusters + 1.0, self._most)
        self.value += (min(ratio, 9.0 * self.value) - self.value) / self._clusters
        self.restart()
