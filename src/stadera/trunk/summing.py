"""Adds a block's rows to the sums: in the unit of the rows, by robust weights, and with a record of their scatter."""

from __future__ import annotations

from dataclasses import replace
from math import sqrt
from types import ModuleType

import numpy as np

from stadera.compiled import kernel
from stadera.trunk.error_model import ERRORS, LEARNT
from stadera.trunk.row_sums import unit_of_rows, weighted
from stadera.trunk.rows import BlockRows
from stadera.trunk.scatter import RobustWeights, Scatter, enough_rows, heaviness
from stadera.trunk.segment import STICTION, RowMoments, Segment, WeightedRows
from stadera.types import Array


class Summing:
    """Adds blocks to segments.

    Args:
        robot_weight: [N]. length: of a leg [m].
        scatter: updated with every block.
    """

    def __init__(self, robot_weight: float, length: float, scatter: Scatter) -> None:
        self._unit, self._scatter = unit_of_rows(robot_weight, length), scatter
        self._robust = RobustWeights(scatter.settings)

    @property
    def tails(self) -> float:
        """See `RobustWeights.tails`."""
        return self._robust.tails

    def add(
        self, made: BlockRows, current: Segment, aged: Segment, errors: Array, keep: float
    ) -> tuple[WeightedRows, Segment]:
        """Returns the weighted rows of a block, and the present estimate with them.

        Args:
            current, aged: the present estimate, and the one without the latest blocks.
            errors: p̂ (ERRORS,), zero but for `LEARNT`.
            keep: factor on the weight of all before.
        """
        rows = weighted(made, self._unit)
        rows = replace(rows, weight=self._robust.weight(rows, current, errors))
        self._scatter.count(rows, aged, errors)
        return rows, current.add(rows, keep)


class CompiledSumming(Summing):
    """The same sums as `Summing`, up to rounding, by the compiled module `stadera.trunk.kernels.sums`."""

    def __init__(self, robot_weight: float, length: float, scatter: Scatter, compiled: ModuleType) -> None:
        super().__init__(robot_weight, length, scatter)
        own, self._compiled = scatter.settings, compiled
        limits = own.remembered, own.least_usual, own.freedom, 1.0, own.outlier
        self._usual = np.array([np.nan, 0.0, *limits, *np.zeros(4)])

    @property
    def tails(self) -> float:
        """See `RobustWeights.tails`."""
        return heaviness(self._usual[7:])

    def add(
        self, made: BlockRows, current: Segment, aged: Segment, errors: Array, keep: float
    ) -> tuple[WeightedRows, Segment]:
        """Returns the weighted rows of a block, and the present estimate with them: see `Summing.add`."""
        scatter, counted = self._scatter, aged.blocks >= self._scatter.settings.cluster
        columns, triangle = np.empty((6, 11 + ERRORS)), np.empty((10, 11 + ERRORS))
        inverse, solution, mean = np.empty((10, 10)), np.empty((10, 1 + ERRORS)), np.empty(10)
        residue, moments = np.empty((6, 1 + ERRORS)), np.empty(85)
        white = self._compiled.digest(
            made.columns,
            made.white,
            self._unit,
            current.triangle,
            current.solution,
            aged.solution,
            errors[LEARNT],
            sqrt(keep),
            enough_rows(current, self._usual[0], scatter.settings),
            counted,
            self._usual,
            scatter.sum,
            scatter.normal,
            columns,
            triangle,
            inverse,
            solution,
            mean,
            residue,
            current.sums.values,
            moments,
            STICTION.start,
        )
        if counted:
            scatter.summed += 1
            scatter.close()
        rows = WeightedRows(made.time, columns, white, float(self._usual[5]))
        known = current.followed(rows, keep, triangle, residue, RowMoments(moments))
        return rows, known.with_solution(inverse, solution, errors, mean)


def summing(robot_weight: float, length: float, scatter: Scatter) -> Summing:
    """The fastest `Summing` of this installation."""
    compiled = kernel("stadera.trunk.kernels.sums")
    if compiled is None:
        return Summing(robot_weight, length, scatter)
    return CompiledSumming(robot_weight, length, scatter, compiled)
