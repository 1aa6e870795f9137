"""Adds a block's rows to the sums: in the unit of the rows, by robust weights, and with a record of their scatter."""

from __future__ import annotations

from dataclasses import replace

from stadera.trunk.row_sums import unit_of_rows, weighted
from stadera.trunk.rows import BlockRows
from stadera.trunk.scatter import RobustWeights, Scatter
from stadera.trunk.segment import Segment, WeightedRows
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
            errors: p̂, zero but for `ErrorLayout.learnt`.
            keep: factor on the weight of all before.
        """
        rows = weighted(made, self._unit)
        rows = replace(rows, weight=self._robust.weight(rows, current, errors))
        self._scatter.count(rows, aged, errors)
        return rows, current.add(rows, keep)
