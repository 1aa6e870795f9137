"""How blocks of rows scatter: single ones that fit far worse than usual, and sums that vary more than rows say."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from stadera.trunk.segment import Segment, WeightedRows
from stadera.types import Array

CLUSTER = 25
"""Blocks whose sums of residuals are compared with what their weights say."""

_ODD = 3  # blocks in succession that may count for less
_LEAST_USUAL = 0.01  # squared, in the rows' unit: residuals below 0.1 % of the weight are no measure of others
_OUTLIER = 25.0  # times the usual squared residual, from which a block counts for less
_PRIOR_CLUSTERS = 4.0  # as many as this, κ counts as one


class OddBlocks:
    """Makes a block that fits far worse than usual count for less, unless it is one of many: a change of the load."""

    def __init__(self) -> None:
        self._usual, self._odd = np.nan, 0

    def limited(self, rows: WeightedRows, known: Segment, errors: Array) -> WeightedRows:
        """The block, weighted, against what is known and errors of the model p̂ (ERRORS,)."""
        if known.blocks < CLUSTER:
            return rows
        residual = rows.target - rows.matrix @ known.mean(errors) - rows.errors @ errors
        square = float(residual @ residual)
        if np.isnan(self._usual):
            self._usual = square
        limit = _OUTLIER * max(self._usual, _LEAST_USUAL)
        self._usual += 0.01 * (min(square, 4.0 * self._usual) - self._usual)
        self._odd = self._odd + 1 if square > limit else 0
        if not 0 < self._odd <= _ODD:
            return rows
        weight = np.sqrt(limit / square)
        return replace(
            rows,
            matrix=weight * rows.matrix,
            errors=weight * rows.errors,
            target=weight * rows.target,
            white=weight**2 * rows.white,
        )


class Scatter:
    """κ: sums of residuals over half a second against what independent rows of unit noise would come to.

    Args:
        wide: (4,) [kg, kg·m], prior of mass and first moment.
        most: clusters that are remembered.
    """

    def __init__(self, wide: Array, most: float) -> None:
        self._prior, self._most = np.diag(1.0 / wide**2), most
        self.value, self._clusters = 1.0, _PRIOR_CLUSTERS
        self.restart()

    def restart(self) -> None:
        """The load has changed: the unfinished sum belongs to two loads."""
        self._sum, self._normal, self._summed = np.zeros(4), np.zeros((4, 4)), 0

    def count(self, rows: WeightedRows, known: Segment, errors: Array) -> None:
        """Takes in a block, against what is known and errors of the model p̂ (ERRORS,)."""
        if known.blocks < CLUSTER:
            return
        moments = rows.moments
        self._sum += moments[:, 10] - moments[:, :10] @ known.mean(errors) - moments[:, 11:] @ errors
        self._normal += moments[:, :4]
        self._summed += 1
        if self._summed == CLUSTER:
            ratio = float(self._sum @ np.linalg.solve(self._normal + self._prior, self._sum)) / 4.0
            self._clusters = min(self._clusters + 1.0, self._most)
            self.value += (min(ratio, 9.0 * self.value) - self.value) / self._clusters
            self.restart()
