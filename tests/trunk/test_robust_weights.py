"""Weights of blocks that fit worse than usual, against the law that they assume and against gross errors."""

from __future__ import annotations

import numpy as np
import pytest

from layout import ERRORS, LAYOUT, rows_of
from stadera.trunk.block_rows import WeightedRows
from stadera.trunk.history import RobustWeights
from stadera.trunk.segment import Segment
from stadera.trunk.settings import OutlierSettings

SETTINGS = OutlierSettings(freedom=5.0)
TRUNK = np.array([50.0, *np.zeros(9)])


def block(k: int, error: np.ndarray, rng: np.random.Generator) -> WeightedRows:
    """A block of the trunk alone, with an error of its six rows."""
    A = rng.standard_normal((6, 10))
    return rows_of(0.02 * k, A, np.zeros((6, ERRORS)), A @ TRUNK + error, 6.0)


def summed(errors: np.ndarray, robust: bool) -> tuple[np.ndarray, RobustWeights, list[float]]:
    """The trunk from blocks with given errors (n, 6), the weights' state, and all weights."""
    rng, weights, segment, given = (
        np.random.default_rng(1),
        RobustWeights(SETTINGS),
        Segment.prior(TRUNK, np.full(10, 1e3), LAYOUT),
        [],
    )
    for k, error in enumerate(errors):
        rows = block(k, error, rng)
        given.append(weights.weight(rows.columns, segment, np.zeros(ERRORS)) if robust else 1.0)
        segment = segment.add(WeightedRows(rows.time, rows.columns, rows.white, given[-1]))
    return segment.mean(np.zeros(ERRORS)), weights, given


def test_usual_residuals_are_the_scale_of_students_law() -> None:
    """Draws of t with five degrees of freedom: the usual square is that of the Gaussian below, not the variance."""
    rng = np.random.default_rng(2)
    scale = np.sqrt(SETTINGS.freedom / rng.chisquare(SETTINGS.freedom, 3000))
    _, weights, given = summed(3.0 * scale[:, None] * rng.standard_normal((3000, 6)), robust=True)
    assert weights.usual == pytest.approx(9.0, rel=0.25)  # over the last hundred blocks; the variance is 15
    assert np.mean(given[200:]) == pytest.approx(1.0, rel=0.1)


def test_impacts_do_not_decide_the_estimate() -> None:
    """Every tenth block has an error ten times as large as the others, always to the same side."""
    rng = np.random.default_rng(3)
    errors = rng.standard_normal((1000, 6))
    errors[::10] *= 10.0
    off = [np.abs(summed(errors, robust)[0] - TRUNK).max() for robust in (False, True)]
    assert off[1] < 0.5 * off[0]
    _, _, found = summed(errors, robust=True)
    given = np.array(found)
    assert given[200::10].mean() < 0.1 * given[201::10].mean()


def test_the_first_blocks_count_in_full() -> None:
    """Without an estimate nothing is usual."""
    rng = np.random.default_rng(4)
    _, _, given = summed(rng.standard_normal((30, 6)), robust=True)
    assert given[: SETTINGS.enough] == [1.0] * SETTINGS.enough
    assert given[-1] != 1.0
