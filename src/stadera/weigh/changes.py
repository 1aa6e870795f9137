"""When the load changed: steps of the mass between blocks at rest.

The rule: a block departs from the mean of its load so far if it differs by more than 1 % of the robot's mass and by
more than five standard deviations of that difference (white noise of both, and what the two poses feel differently of
constant errors). Where two blocks in a row depart to the same side, the load has changed, at the first of them; a
single one is left out as a disturbance.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from math import sqrt

import numpy as np
from numpy.typing import NDArray

from stadera.estimate.equilibrium import ConstantErrors
from stadera.weigh.rest import Block, MeanMass, felt_variance
from stadera.weigh.result import Change

LEAST_SHARE, DEVIATIONS = 0.01, 5.0
"""Of the robot's mass, and of standard deviations, that a change is larger than."""


def loads(blocks: Sequence[Block], robot_mass: float, errors: ConstantErrors) -> list[MeanMass]:
    """The mean mass of each load in turn, disturbances left out; none without blocks."""
    means: list[MeanMass] = []
    waiting: Block | None = None
    for block in blocks:
        if not means:
            means.append(MeanMass.of(block))
        elif not _departs(means[-1], block, robot_mass, errors):
            means[-1] = means[-1].with_block(block)
            waiting = None
        elif waiting is not None and (waiting.mass > means[-1].mass) == (block.mass > means[-1].mass):
            means.append(MeanMass.of(waiting).with_block(block))
            waiting = None
        else:
            waiting = block
    return means


def levels(blocks: Sequence[Block], means: Sequence[MeanMass]) -> NDArray[np.int64]:
    """(blocks,), the number of changes before each block."""
    starts = [mean.begin for mean in means[1:]]
    return np.searchsorted(starts, [block.begin for block in blocks], side="right").astype(np.int64)


def changes_between(means: Sequence[MeanMass], errors: ConstantErrors) -> tuple[Change, ...]:
    """The steps from one load to the next."""
    changes = []
    for before, after in pairwise(means):
        variance = before.variance + after.variance + felt_variance(after.felt - before.felt, errors)
        changes.append(Change(after.begin, after.mass - before.mass, sqrt(variance)))
    return tuple(changes)


def _departs(mean: MeanMass, block: Block, robot_mass: float, errors: ConstantErrors) -> bool:
    std = sqrt(mean.variance + block.variance + felt_variance(block.felt - mean.felt, errors))
    return abs(block.mass - mean.mass) > max(LEAST_SHARE * robot_mass, DEVIATIONS * std)
