"""Scatter of the rows: weights of blocks that fit worse than usual, and sums that vary more than weights predict."""

from __future__ import annotations

import numpy as np

from stadera.trunk.segment import Segment, WeightedRows
from stadera.trunk.settings import OutlierSettings
from stadera.types import Array


def enough_rows(known: Segment, usual: float, settings: OutlierSettings) -> bool:
    """True if the estimate has enough rows to evaluate a block with; `usual` as in `OddBlocks`, NaN before any."""
    return known.blocks >= (settings.cluster if np.isnan(usual) else settings.afresh)


class RobustWeights:
    """Weights of blocks by their residuals, as if these had Student's t distribution with ν degrees of freedom.

    A block of n = 6 rows whose mean square is q times the usual one u counts for

        w = (ν + n) / (ν + n q),      u = Σ w |r|² / (n Σ w)

    as of the EM algorithm (Lange, Little and Taylor, Robust statistical modeling using the t distribution, J. Am. Stat.
    Assoc. 84 (1989) 881). u is averaged over the latest blocks.

    Attributes:
        usual: u [1], in the rows' unit; NaN before any. count: number of blocks that it is an average of.
        sums: of all blocks, their number, mean squares, clipped at `OutlierSettings.outlier` times u, weights, and
            weights times mean squares.
    """

    def __init__(self, settings: OutlierSettings) -> None:
        self._settings = settings
        self.usual, self.count, self.sums = np.nan, 0.0, np.zeros(4)

    @property
    def tails(self) -> float:
        """Mean square of all residuals over that of the weighted ones: one if they are Gaussian, above it if not."""
        return heaviness(self.sums)

    def weight(self, rows: WeightedRows, known: Segment, errors: Array) -> float:
        """w of a block, given the estimate and model errors p̂ (ERRORS,); one before there are enough rows."""
        if not enough_rows(known, self.usual, self._settings):
            return 1.0
        residual, settings = rows.residual(known.mean(errors), errors), self._settings
        square = float(residual @ residual) / 6.0
        if np.isnan(self.usual):
            self.usual = square
        weight = student_weight(square, max(self.usual, settings.least_usual), settings.freedom)
        self.count = min(self.count + 1.0, settings.remembered)
        self.usual += weight * (square - self.usual) / self.count
        self.sums += 1.0, min(square, settings.outlier * self.usual), weight, weight * square
        return weight


def heaviness(sums: Array) -> float:
    """`RobustWeights.tails`, of its sums (4,)."""
    blocks, squares, weights, weighted = sums.tolist()
    return squares * weights / (blocks * weighted) if weighted > 0.0 else 1.0


def student_weight(square: float, usual: float, freedom: float) -> float:
    """Weight of a block of six rows with a mean square residual; `usual` as in `RobustWeights`."""
    return (freedom + 6.0) / (freedom + 6.0 * square / usual)


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
        self.sum += rows.weight * (shown @ rows.residual(known.mean(errors), errors))
        self.normal += rows.weight * (shown @ shown.T)
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
