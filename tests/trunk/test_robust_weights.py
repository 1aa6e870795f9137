"""Weights of blocks that fit worse than usual, against the law that they assume and against gross errors."""

from __future__ import annotations

from dataclasses import replace

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


def settled() -> RobustWeights:
    """Weights for which usual residuals are noise of variance one."""
    weights = RobustWeights(SETTINGS)
    weights.usual, weights.count = np.array(1.0), 1.0
    return weights


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


def test_what_an_uncertain_error_may_do_is_not_unusual() -> None:
    """Residuals of draws of an error and of noise, by the estimate from earlier rows that errors hide too: their mean
    square by S, rᵀ S⁻¹ r, is n, so draws have the weight of usual ones in the mean; taken for certain they have next to
    none.
    """
    rng, root = np.random.default_rng(5), np.zeros((ERRORS, 3))
    root[:3] = 3.0 * np.eye(3)
    columns = [np.hstack([rng.standard_normal((6, 11)), rng.standard_normal((6, ERRORS))]) for _ in range(31)]
    found = []
    for _ in range(300):
        p, segment = root @ rng.standard_normal(3), Segment.prior(TRUNK, np.full(10, 1e3), LAYOUT)
        for k, each in enumerate(columns):
            each[:, 10] = each[:, :10] @ TRUNK + each[:, 11:] @ p + rng.standard_normal(6)
            if k < 30:
                segment = segment.add(WeightedRows(0.0, each.copy(), 6.0))
        found.append([settled().weight(columns[-1], segment, np.zeros(ERRORS), C) for C in (root @ root.T, None)])
    far, certain = ((SETTINGS.freedom + 6.0) / np.array(found) - SETTINGS.freedom).T
    assert far.mean() == pytest.approx(6.0, abs=0.6)  # χ² of six degrees of freedom, mean of 300: ± 0.2
    assert certain.mean() > 60.0


def test_what_no_uncertain_error_explains_counts_as_an_outlier() -> None:
    """An uncertain error acts on the first row, a gross one on the last."""
    columns, root = np.zeros((6, 11 + ERRORS)), np.zeros((ERRORS, ERRORS))
    columns[0, 11], root[0, 0] = 1.0, 30.0**2
    segment = replace(Segment.prior(TRUNK, np.full(10, 1e3), LAYOUT), blocks=SETTINGS.enough)
    found = []
    for row in (0, 5):
        columns[:, 10] = np.where(np.arange(6) == row, 30.0, 0.0)
        found.append(settled().weight(columns, segment, np.zeros(ERRORS), root))
    assert found[0] > 1.0
    assert found[1] == pytest.approx((SETTINGS.freedom + 6.0) / (SETTINGS.freedom + 900.0))
