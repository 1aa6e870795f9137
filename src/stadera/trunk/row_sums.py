"""Unit of the rows, and their sums over all loads of a robot."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from stadera.constants import GRAVITY
from stadera.robot.model import Robot
from stadera.trunk.rows import BlockRows
from stadera.trunk.segment import Segment, WeightedRows
from stadera.types import Array

_UNIT = 0.01  # of weight, and of weight times leg length: the unit of the rows


def unit_of_rows(robot_weight: float, length: float) -> Array:
    """Unit of the rows (6,): 1 % of the robot's weight [N], of moments that with the leg's length as lever [N·m].

    It is the same for all blocks. Weights that follow the white noise of each block would be optimal if that were the
    only error. On real robots they are worse: the apparent momentum from late torques, rotor inertia and friction
    cancels over whole steps, but only if all phases of a step count about equally.
    """
    return np.asarray(_UNIT * robot_weight * np.array([1.0, 1.0, 1.0, length, length, length]))


def weighted(rows: BlockRows, unit: Array) -> WeightedRows:
    """Scales rows to their `unit_of_rows`."""
    white, late = (float((own / unit**2).sum()) for own in (rows.white, rows.late))
    return WeightedRows(rows.time, rows.columns / unit[:, None], white, late=late)


@dataclass(frozen=True, eq=False)
class RowSums:
    """Sums over the rows of all loads, with θ eliminated.

    Attributes:
        remainder: see `Segment.remainder`, over all blocks. in_motion: the same over blocks in which the robot moves.
        weight: sum of the weights of the blocks in motion [1].
        repeated: number of successive rows with the same error [1], which persists through a swing or a stance.
        returning: number of rows after which such errors have returned, so that further rows tell nothing new [1].
        white: Σ of all rows' white variance [1].
        late: Σ of its variance in the column of the torques' lag, over rows in motion [1/s²].
    """

    remainder: Array
    in_motion: Array
    weight: float
    repeated: float
    white: float = 0.0
    returning: float = float("inf")
    late: float = 0.0

    @classmethod
    def of(cls, segments: Sequence[Segment], repeated: float, returning: float = float("inf")) -> RowSums:
        """Sums up segments of the same robot."""
        first, *others = segments
        total = cls(first.remainder, first.in_motion, first.moved, repeated, first.white, returning, first.late)
        for segment in others:
            total = total.plus(segment)
        return total

    def plus(self, segment: Segment) -> RowSums:
        """With one more segment."""
        return RowSums(
            self.remainder + segment.remainder,
            self.in_motion + segment.in_motion,
            self.weight + segment.moved,
            self.repeated,
            self.white + segment.white,
            self.returning,
            self.late + segment.late,
        )

    @property
    def repeats(self) -> float:
        """Number of rows that share one error [1]."""
        return self.repeated * max(self.weight / self.returning, 1.0)


def robot_weight(robot: Robot) -> float:
    """Weight of the robot model [N]."""
    return GRAVITY * robot.mass
