"""Detects changes of the load between blocks at rest.

A block deviates from the mean of its load if it differs by more than a share of the robot's mass and by more than a
number of standard deviations of the difference (white noise of both, and constant errors as far as they differ between
the two poses); `WeighSettings` has both limits. If two successive blocks deviate to the same side, the load changed at
the first of them. A single deviating block is discarded as a disturbance.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from math import sqrt

import numpy as np
from numpy.typing import NDArray

from stadera.trunk.load import LoadChange
from stadera.trunk.standing.equilibrium import ConstantErrors
from stadera.weigh.rest import RestBlock, change_variance, constant_variance, difference_variance


@dataclass(frozen=True, eq=False)
class LevelLimits:
    """Limits above which a block deviates from its load's mean: least difference [kg], and in standard deviations,
    given the covariance of the constant errors.
    """

    mass: float
    deviations: float
    errors: ConstantErrors

    def departs(self, mean: RestBlock, block: RestBlock) -> bool:
        """True if a block deviates from the mean of its load."""
        std = sqrt(difference_variance(mean, block, self.errors))
        return abs(block.mass - mean.mass) > max(self.mass, self.deviations * std)


def loads(blocks: Sequence[RestBlock], limits: LevelLimits) -> list[RestBlock]:
    """The mean mass of each successive load, without disturbances; empty without blocks."""
    means: list[RestBlock] = []
    waiting: RestBlock | None = None
    for block in blocks:
        if not means:
            means.append(block)
        elif not limits.departs(means[-1], block):
            means[-1] = means[-1].joined(block)
            waiting = None
        elif waiting is not None and (waiting.mass > means[-1].mass) == (block.mass > means[-1].mass):
            means.append(replace(waiting, noticed=block.end).joined(block))
            waiting = None
        else:
            waiting = block
    return means


def levels(blocks: Sequence[RestBlock], means: Sequence[RestBlock]) -> NDArray[np.int64]:
    """Number of changes before each block, (blocks,)."""
    starts = [mean.begin for mean in means[1:]]
    return np.searchsorted(starts, [block.begin for block in blocks], side="right").astype(np.int64)


def changes_between(means: Sequence[RestBlock], errors: ConstantErrors) -> tuple[LoadChange, ...]:
    """The changes from each load to the next."""
    changes = []
    for before, after in pairwise(means):
        variance = change_variance(before, after, errors)
        mass = after.mass - before.mass
        changes.append(LoadChange(after.begin, after.noticed, mass, sqrt(variance), "on" if mass > 0 else "off"))
    return tuple(changes)


def misfit(
    blocks: Sequence[RestBlock], level: NDArray[np.int64], means: Sequence[RestBlock], limits: LevelLimits
) -> float:
    """Variance of the blocks' masses about the mean of their load, divided by the stated one; NaN for too few blocks.
    Disturbances, which `loads` discards, are excluded. Each mean takes one degree of freedom.
    """
    squares, freedom = 0.0, -len(means)
    for block, at in zip(blocks, level, strict=True):
        mean = means[at]
        if not limits.departs(mean, block):
            variance = block.variance + constant_variance(block.sensitivity - mean.sensitivity, limits.errors)
            squares, freedom = squares + (block.mass - mean.mass) ** 2 / variance, freedom + 1
    return squares / freedom if freedom > 0 else np.nan
