"""Scatter of the rows: outlying single blocks, and sums that vary more than their weights predict."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from stadera.trunk.segment import Segment, WeightedRows
from stadera.types import Array

CLUSTER = 25
"""Blocks in a cluster, whose sum of residuals is compared with its predicted variance."""

_AFRESH = 6  # blocks of a new load, against which a block is judged by what was usual before
_ODD = 3  # successive blocks that may be down-weighted
_LEAST_USUAL = 0.01  # squared, in the rows' unit: residuals below 0.1 % of the weight do not define the usual ones
_OUTLIER = 25.0  # times the usual squared residual, above which a block is down-weighted
_PRIOR_CLUSTERS = 4.0  # number of clusters that the prior κ = 1 counts as


def judged(known: Segment, usual: float) -> bool:
    """True if the estimate has enough rows to judge a block by; `usual` as in `OddBlocks`, NaN before any."""
    return known.blocks >= (CLUSTER if np.isnan(usual) else _AFRESH)


class OddBlocks:
    """Down-weights blocks that fit far worse than usual, except many in succession, which indicate a change of the
    load.

    Attributes:
        usual: squared residual of usual blocks. odd: number of successive odd blocks.
    """

    def __init__(self) -> None:
        self.usual, self.odd = np.nan, 0

    def limited(self, rows: WeightedRows, known: Segment, errors: Array) -> WeightedRows:
        """Returns the block, weighted, given the estimate and model errors p̂ (ERRORS,)."""
        if not judged(known, self.usual):
            return rows
        residual = rows.residual(known.mean(errors), errors)
        square = float(residual @ residual)
        if np.isnan(self.usual):
            self.usual = square
        limit = _OUTLIER * max(self.usual, _LEAST_USUAL)
        self.usual += 0.01 * (min(square, 4.0 * self.usual) - self.usual)
        self.odd = self.odd + 1 if square > limit else 0
        if not 0 < self.odd <= _ODD:
            return rows
        weight = np.sqrt(limit / square)
        return replace(rows, columns=weight * rows.columns, white=weight**2 * rows.white)


class Scatter:
    """κ: sums of residuals over half a second, compared with those of independent rows of unit noise.

    Args:
        wide: (4,) [kg, kg·m], prior of mass and first moment.
        most: number of clusters in memory.

    Attributes:
        value: κ.
        sum, normal, summed: Σ Aᵀ r (4,), Σ Aᵀ A (4, 4) and number of blocks of the unfinished sum.
    """

    def __init__(self, wide: Array, most: float) -> None:
        self._prior, self._most = np.diag(1.0 / wide**2), most
        self.value, self._clusters = 1.0, _PRIOR_CLUSTERS
        self.restart()

    def restart(self) -> None:
        """Discards the unfinished sum after a change of the load."""
        self.sum, self.normal, self.summed = np.zeros(4), np.zeros((4, 4)), 0

    def count(self, rows: WeightedRows, known: Segment, errors: Array) -> None:
        """Adds a block, given the estimate and model errors p̂ (ERRORS,)."""
        if known.blocks < CLUSTER:
            return
        shown = rows.columns[:, :4].T
        self.sum += shown @ rows.residual(known.mean(errors), errors)
        self.normal += shown @ shown.T
        self.summed += 1
        self.close()

    def close(self) -> None:
        """Updates κ once the sum is complete."""
        if self.summed < CLUSTER:
            return
        ratio = float(self.sum @ np.linalg.solve(self.normal + self._prior, self.sum)) / 4.0
        self._clusters = min(self._clusters + 1.0, self._most)
        self.value += (min(ratio, 9.0 * self.value) - self.value) / self._clusters
        self.restart()
