"""A load that stays the same: how far its estimate moves within a log widens its bar."""

from __future__ import annotations

import numpy as np
import pytest

from layout import ERRORS, LAYOUT, rows_of
from stadera.robot import load_robot
from stadera.trunk.block_rows import BlockRows, SwingRows
from stadera.trunk.error_model import ErrorModel
from stadera.trunk.history import History
from stadera.trunk.joint_errors import Errors
from stadera.trunk.segment import Segment
from stadera.trunk.settings import ModelErrors, SwingDetection, TrunkSettings
from stadera.trunk.swing import SwingJoints

MODEL = ErrorModel(load_robot("hyq"), ModelErrors(), 0.7)
ERRORS_OF_IT = Errors(MODEL, SwingJoints(MODEL, SwingDetection()))
BLOCKS = 120


def segment_of(first: np.ndarray, then: np.ndarray, seed: int = 3) -> Segment:
    """Blocks of exact rows of a trunk that seems to have other parameters (10,) in the second half."""
    rng, segment = np.random.default_rng(seed), Segment.prior(np.zeros(10), np.full(10, 1e3), LAYOUT)
    for k in range(BLOCKS):
        A, theta = rng.standard_normal((6, 10)), first if 2 * k < BLOCKS else then
        segment = segment.add(rows_of(0.02 * k, A, np.zeros((6, ERRORS)), A @ theta, 1.0))
    return segment


def test_marks_are_at_a_quarter_to_half_of_the_weight_and_keep_no_rows() -> None:
    segment = Segment.prior(np.zeros(10), np.full(10, 1e3), LAYOUT)
    rows = rows_of(0.0, np.eye(6, 10), np.zeros((6, ERRORS)), np.ones(6), 1.0)
    for _ in range(400):
        segment = segment.add(rows)
        earlier = segment.earlier
        assert (earlier is None) == (segment.blocks <= 50)
        if earlier is not None:
            assert 0.25 * segment.blocks - 1.0 <= earlier.blocks <= 0.5 * segment.blocks
            assert not earlier.marks
            assert not earlier.residues.products[0].any()


def test_an_estimate_that_moves_is_known_no_better_than_it_moves() -> None:
    """Rows alone, without errors of the model: the variance between the first part and all, as of two groups."""
    theta, moved = np.zeros(10), np.array([3.0, -1.0, 0.5, 2.0, *np.zeros(6)])
    same, other = segment_of(theta, theta), segment_of(theta, theta + moved)
    P = same.inverse @ same.inverse.T
    assert ERRORS_OF_IT.of_rows(same) == pytest.approx(P, abs=1e-12)
    added = ERRORS_OF_IT.of_rows(other) - P

    A = np.random.default_rng(3).standard_normal((BLOCKS, 6, 10))
    earlier = other.earlier
    assert earlier is not None
    n = earlier.blocks
    b = np.where(np.arange(BLOCKS)[:, None] * 2 < BLOCKS, 0.0, A @ moved).reshape(-1)
    whole = np.linalg.lstsq(A.reshape(-1, 10), b)[0]
    d = whole - np.linalg.lstsq(A[:n].reshape(-1, 10), b[: 6 * n])[0]
    covariance = sum(np.linalg.inv(np.einsum("kij,kil->jl", part, part)) for part in (A[:n], A))
    square = float(d[:4] @ np.linalg.solve(covariance[:4, :4], d[:4]))
    assert square > 100.0
    assert added == pytest.approx(np.outer(d, d) * (1.0 - 4.0 / square), rel=1e-3, abs=1e-6)


def test_what_moved_counts_in_a_payload_of_either_load() -> None:
    theta, moved = np.zeros(10), np.array([5.0, *np.zeros(9)])
    quiet, loud = segment_of(theta, theta), segment_of(theta, theta + moved)
    usual = ERRORS_OF_IT.difference_covariance(quiet, quiet)[0, 0]
    once = ERRORS_OF_IT.difference_covariance(quiet, loud)[0, 0]
    twice = ERRORS_OF_IT.difference_covariance(loud, loud)[0, 0]
    assert once > usual + 1.0
    assert twice - once == pytest.approx(once - usual)


def test_noise_alone_moves_no_estimate() -> None:
    """With white noise of the rows' unit and no error of the model, χ² rarely exceeds its mean by much."""
    added, rng = [], np.random.default_rng(11)
    for _ in range(20):
        segment = Segment.prior(np.zeros(10), np.full(10, 1e3), LAYOUT)
        for k in range(80):
            A = rng.standard_normal((6, 10))
            b = rng.standard_normal(6)
            segment = segment.add(rows_of(0.02 * k, A, np.zeros((6, ERRORS)), b, 1.0))
        P = segment.inverse @ segment.inverse.T
        added.append(ERRORS_OF_IT.of_rows(segment)[0, 0] / P[0, 0])
    assert 1.0 <= np.median(added) < 1.2


def test_a_load_that_is_not_noticed_after_a_tare_is_no_error_of_the_model() -> None:
    """Exact rows of one trunk before the tare and of another since then leave no residual."""
    robot, rng, none = load_robot("hyq"), np.random.default_rng(2), np.zeros(ERRORS)
    history = History(robot, np.zeros(10), LAYOUT, TrunkSettings())
    swing = SwingRows(np.zeros(12, dtype=bool), *[np.empty((0, 0))] * 4, slides=np.ones((2, 12), dtype=bool))
    for k in range(200):
        if k == 100:
            history.set_tare(none)
        A = rng.standard_normal((6, 10))
        b = A @ np.array([30.0 + 5.0 * (k >= 100), *np.zeros(9)])
        columns = np.hstack([A, b[:, None], np.zeros((6, ERRORS))])
        history.add(BlockRows(0.02 * k, 0.02, columns, np.ones(6), swing, np.zeros(12)), none)
    assert history.current.remainder[0, 0] > 100.0
    assert history.total.in_motion[0, 0] < 1.0
