"""A load that stays the same: how far its estimate moves within a log widens its bar."""

from __future__ import annotations

import numpy as np
import pytest

from layout import ERRORS, LAYOUT, rows_of
from stadera.robot import load_robot
from stadera.trunk.batches import Batches
from stadera.trunk.block_rows import BlockRows, SwingRows
from stadera.trunk.error_model import ErrorModel
from stadera.trunk.history import History
from stadera.trunk.joint_errors import Errors
from stadera.trunk.segment import Segment
from stadera.trunk.settings import ModelErrors, SwingDetection, TrunkSettings
from stadera.trunk.swing import SwingJoints

MODEL = ErrorModel(load_robot("hyq"), ModelErrors())
ERRORS_OF_IT = Errors(MODEL, SwingJoints(MODEL, SwingDetection()))
BLOCKS = 120


def segment_of(first: np.ndarray, then: np.ndarray, seed: int = 3) -> Segment:
    """Blocks of exact rows of a trunk that seems to have other parameters (10,) in the second half."""
    rng, segment = np.random.default_rng(seed), Segment.prior(np.zeros(10), np.full(10, 1e3), LAYOUT)
    for k in range(BLOCKS):
        A, theta = rng.standard_normal((6, 10)), first if 2 * k < BLOCKS else then
        segment = segment.add(rows_of(0.02 * k, A, np.zeros((6, ERRORS)), A @ theta, 1.0))
    return segment


def test_parts_stay_few_and_hold_all_rows() -> None:
    """Their sum is that of all blocks, with the weight that forgetting leaves; the oldest may be shorter."""
    rng, keep, batches = np.random.default_rng(1), 0.999, Batches()
    total, weight = np.zeros((10, 14)), 0.0
    for _ in range(3000):
        columns, share = rng.standard_normal((6, 14)), rng.uniform(0.2, 1.0)
        batches = batches.add(columns, 2.0, share, keep)
        total, weight = keep * total + 2.0 * columns[:, :10].T @ columns, keep * weight + 2.0 * share
        assert len(batches.parts) <= 17
    factors = rng.standard_normal(14)
    pulls, count = batches.pulls(np.eye(10), factors)
    assert pulls.sum(axis=1) == pytest.approx(total @ factors)
    assert sum(batches.weights) == pytest.approx(weight)
    assert 6.0 < count < 17.0


@pytest.mark.parametrize(("loud", "lasting"), [(1.0, 1), (10.0, 10)])
def test_the_bar_is_that_of_the_estimate_by_noise_of_any_kind(loud: float, lasting: int) -> None:
    """White noise of the rows' unit, and noise that is louder and lasts: against the scatter of estimates."""
    found, stated = [], []
    noise = np.zeros(6)
    for seed in range(60):
        rng, segment = np.random.default_rng(seed), Segment.prior(np.zeros(10), np.full(10, 1e3), LAYOUT)
        for k in range(200):
            if k % lasting == 0:
                noise = loud * rng.standard_normal(6)
            A = np.array([3.0, *np.zeros(9)]) + 0.3 * rng.standard_normal((6, 10))
            segment = segment.add(rows_of(0.02 * k, A, np.zeros((6, ERRORS)), noise, 1.0))
        found.append(segment.mean(np.zeros(ERRORS))[0])
        stated.append(ERRORS_OF_IT.of_rows(segment)[0, 0])
    assert np.sqrt(np.mean(stated)) == pytest.approx(np.std(found), rel=0.25)


def test_an_estimate_that_moves_is_known_no_better_than_it_moves() -> None:
    theta, moved = np.zeros(10), np.array([3.0, -1.0, 0.5, 2.0, *np.zeros(6)])
    same, other = (ERRORS_OF_IT.of_rows(segment_of(theta, theta + step)) for step in (0.0 * moved, moved))
    stds = np.sqrt(np.diag(other - same))[:4]
    # of n independent parts, half of which are off by d, the mean has the standard deviation d / 2√(n - 1), n = 4.8
    assert (stds > 0.15 * np.abs(moved[:4])).all()
    assert (stds < 0.35 * np.abs(moved[:4])).all()


def test_what_moved_counts_in_a_payload_of_either_load() -> None:
    theta, moved = np.zeros(10), np.array([5.0, *np.zeros(9)])
    quiet, loud = segment_of(theta, theta), segment_of(theta, theta + moved)
    usual = ERRORS_OF_IT.difference_covariance(quiet, quiet)[0, 0]
    once = ERRORS_OF_IT.difference_covariance(quiet, loud)[0, 0]
    twice = ERRORS_OF_IT.difference_covariance(loud, loud)[0, 0]
    assert once > usual + 0.5
    assert twice - once == pytest.approx(once - usual)


def test_a_load_that_is_not_noticed_after_a_tare_is_no_error_of_the_model() -> None:
    """Exact rows of one trunk before the tare and of another since then leave no residual."""
    robot, rng, none = load_robot("hyq"), np.random.default_rng(2), np.zeros(ERRORS)
    history = History(robot, np.zeros(10), LAYOUT, TrunkSettings())
    swing = SwingRows(np.zeros(12, dtype=bool), *[np.empty((0, 0))] * 4, np.ones((2, 12), dtype=bool), np.zeros(12))
    for k in range(200):
        if k == 100:
            history.set_tare(none)
        A = rng.standard_normal((6, 10))
        b = A @ np.array([30.0 + 5.0 * (k >= 100), *np.zeros(9)])
        columns = np.hstack([A, b[:, None], np.zeros((6, ERRORS))])
        history.add(BlockRows(0.02 * k, 0.02, columns, np.ones(6), swing), none)
    assert history.current.remainder[0, 0] > 100.0
    assert history.total.in_motion[0, 0] < 1.0
