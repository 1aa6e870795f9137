"""Changes of the load between blocks at rest.

A block departs from the mean of its load so far if it differs by more than a share of the robot's mass and by more than
some standard deviations of the difference (white noise of both, and what constant errors do differently to the two
poses); `WeighSettings` has both numbers. Where two blocks in a row depart to the same side, the load has changed at the
first of them; a single one is left out as a disturbance.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import sqrt

import numpy as np
from numpy.typing import NDArray

from stadera.trunk.load import LoadChange
from stadera.trunk.standing.equilibrium import ConstantErrors
from stadera.weigh.rest import MeanMass, RestBlock, constant_variance, difference_variance


@dataclass(frozen=True, eq=False)
class LevelLimits:
    """When a block departs.

    Attributes:
        mass: least difference [kg].
        deviations: the same in standard deviations.
        errors: the constant errors.
    """

    mass: float
    deviations: float
    errors: ConstantErrors

    def departs(self, mean: MeanMass, block: RestBlock) -> bool:
        """Whether a block differs from the mean of its load."""
        std = sqrt(difference_variance(mean, block, self.errors))
        return abs(block.mass - mean.mass) > max(self.mass, self.deviations * std)


def loads(blocks: Sequence[RestBlock], limits: LevelLimits) -> list[MeanMass]:
    """The mean mass of each load in turn, disturbances left out; none without blocks."""
    means: list[MeanMass] = []
    waiting: RestBlock | None = None
    for block in blocks:
        if not means:
            means.append(MeanMass.of(block))
        elif not limits.departs(means[-1], block):
            means[-1] = means[-1].with_block(block)
            waiting = None
        elif waiting is not None and (waiting.mass > means[-1].mass) == (block.mass > means[-1].mass):
            means.append(MeanMass.of(waiting, block.end).with_block(block))
            waiting = None
        else:
            waiting = block
    return means


def levels(blocks: Sequence[RestBlock], means: Sequence[MeanMass]) -> NDArray[np.int64]:
    """(blocks,), the number of changes before each block."""
    starts = [mean.begin for mean in means[1:]]
    return np.searchsorted(starts, [block.begin for block in blocks], side="right").astype(np.int64)


def changes_between(means: Sequence[MeanMass], errors: ConstantErrors) -> tuple[LoadChange, ...]:
    """The steps from one load to the next."""
    changes = []
    for before, after in pairwise(means):
        variance = difference_variance(before, after, errors)
        mass = after.mass - before.mass
        changes.append(LoadChange(after.begin, after.noticed, mass, sqrt(variance), "on" if mass > 0 else "off"))
    return tuple(changes)


def misfit(
    blocks: Sequence[RestBlock], level: NDArray[np.int64], means: Sequence[MeanMass], limits: LevelLimits
) -> float:
    """Variance of the blocks' masses about the mean of their load, over the stated one; NaN for too few blocks.

    Disturbances, which `loads` leaves out, are left out here too. A mean takes one degree of freedom.
    """
    squares, freedom = 0.0, -len(means)
    for block, at in zip(blocks, level, strict=True):
        mean = means[at]
        if not limits.departs(mean, block):
            variance = block.variance + constant_variance(block.sensitivity - mean.sensitivity, limits.errors)
            squares, freedom = squares + (block.mass - mean.mass) ** 2 / variance, freedom + 1
    return squares / freedom if freedom > 0 else np.nan
