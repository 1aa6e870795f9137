"""The square-root information filter against the Kalman filter's covariance form."""

from __future__ import annotations

import numpy as np
import pytest

from stadera.estimate.square_root import SquareRoot

RNG = np.random.default_rng(0)
MEAN, STD = RNG.standard_normal(5), RNG.uniform(0.5, 2.0, 5)


def some_rows(rows: int = 3, unknowns: int = 5) -> tuple[np.ndarray, np.ndarray]:
    return RNG.standard_normal((rows, unknowns)), RNG.standard_normal(rows)


def kalman(x: np.ndarray, P: np.ndarray, H: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    gain = P @ H.T @ np.linalg.inv(np.eye(len(y)) + H @ P @ H.T)
    return x + gain @ (y - H @ x), P - gain @ H @ P


def test_measuring_and_diffusing_are_the_kalman_filter() -> None:
    known, x, P = SquareRoot.prior(MEAN, STD), MEAN, np.diag(STD**2)
    std = np.array([0.3, 0.7])
    for _ in range(4):
        H, y = some_rows()
        known = known.diffuse(slice(1, 3), std).measure(H, y)
        P = P + np.diag([0.0, *std**2, 0.0, 0.0])
        x, P = kalman(x, P, H, y)
    np.testing.assert_allclose(known.mean, x, atol=1e-12)
    np.testing.assert_allclose(known.covariance(), P, atol=1e-12)


def test_a_copy_stays_while_the_original_goes_on() -> None:
    H, y = some_rows(6)
    known = SquareRoot.prior(MEAN, STD).measure(H, y)
    both = known.repeat(slice(0, 2))
    np.testing.assert_allclose(both.mean[5:], known.mean[:2], atol=1e-9)
    np.testing.assert_allclose(both.covariance(slice(5, 7)), known.covariance(slice(0, 2)), rtol=1e-5)
    root = both.inverse[:2] - both.inverse[5:]
    assert np.abs(root @ root.T).max() < 1e-10
    moved = both.diffuse(slice(0, 2), np.array([1.0, 2.0]))
    root = moved.inverse[:2] - moved.inverse[5:]
    np.testing.assert_allclose(root @ root.T, np.diag([1.0, 4.0]), atol=1e-8)
    np.testing.assert_allclose(moved.first(5).diffuse(slice(0, 0), np.zeros(0)).mean, moved.mean[:5], atol=1e-9)


def test_the_first_unknowns_alone_are_the_marginal() -> None:
    H, y = some_rows(6)
    known = SquareRoot.prior(MEAN, STD).measure(H, y)
    np.testing.assert_allclose(known.first(2).covariance(), known.covariance(slice(0, 2)), atol=1e-12)
    np.testing.assert_allclose(known.first(2).mean, known.mean[:2], atol=1e-12)


@pytest.mark.parametrize("rows", [1, 3, 20])
def test_any_number_of_rows(rows: int) -> None:
    H, y = some_rows(rows)
    x, P = kalman(MEAN, np.diag(STD**2), H, y)
    known = SquareRoot.prior(MEAN, STD).measure(H, y)
    np.testing.assert_allclose(known.mean, x, atol=1e-12)
    np.testing.assert_allclose(known.covariance(), P, atol=1e-12)


def test_errors_that_are_considered_do_what_they_do_to_least_squares() -> None:
    """Estimate and covariance of x when rows are H x + B p = y and p is taken for zero, by normal equations."""
    considered = 4
    known = SquareRoot.prior(MEAN, STD, considered)
    rows, errors, targets = [np.diag(1.0 / STD)], [np.zeros((5, considered))], [MEAN / STD]
    for _ in range(3):
        H, y = some_rows(4)
        B = RNG.standard_normal((4, considered))
        known = known.measure(H, y, B)
        rows.append(H)
        errors.append(B)
        targets.append(y)
    H, B, y = np.vstack(rows), np.vstack(errors), np.concatenate(targets)
    P = np.linalg.inv(H.T @ H)
    off = P @ H.T @ B
    np.testing.assert_allclose(known.mean, P @ H.T @ y, atol=1e-12)
    np.testing.assert_allclose(known.covariance(), P + off @ off.T, atol=1e-12)
    np.testing.assert_allclose(known.first(2).covariance(), known.covariance(slice(0, 2)), atol=1e-12)
    wider = known.diffuse(slice(1, 3), np.array([0.5, 2.0]))
    np.testing.assert_allclose(wider.covariance(), known.covariance() + np.diag([0.0, 0.25, 4.0, 0.0, 0.0]), atol=1e-12)


def test_an_error_that_acts_on_both_alike_cancels_in_the_difference() -> None:
    """Of an unknown and its copy: also when the original jumps and is measured anew, under the same error."""
    rows, error = 100.0 * np.eye(5), 100.0 * RNG.standard_normal((5, 1))
    known = SquareRoot.prior(MEAN, STD, 1).measure(rows, np.zeros(5), error).repeat(slice(0, 5))
    wide = known.diffuse(slice(0, 5), np.full(5, 10.0)).measure(np.eye(5, 10) * 100.0, np.ones(5), error)
    for both in (known, wide):
        assert np.abs(both.root[:5, -1]).min() > 0.01
        np.testing.assert_allclose(both.root[:5, -1], both.root[5:, -1], rtol=1e-3)
    alone = known.diffuse(slice(0, 5), np.full(5, 10.0)).measure(np.eye(5, 10) * 100.0, np.ones(5))
    assert np.abs(alone.root[:5, -1]).max() < 1e-3, (
        "an error that is not felt any more is not in what was measured anew"
    )
