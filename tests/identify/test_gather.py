"""Correlated residuals: how many samples count as one, and that information is worth so much less."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from stadera.body import Rows
from stadera.identify.gather import LAG, Gathered, correlation_length, independent_rows
from stadera.information import Information


@pytest.mark.parametrize("rho", [0.0, 0.5, 0.9])
def test_an_autoregressive_series_has_its_correlation_length(rho: float) -> None:
    """Of x_k = ρ x_k-1 + w_k: 1 + 2 Σ ρ^k = (1 + ρ) / (1 - ρ)."""
    series = lfilter([1.0], [1.0, -rho], np.random.default_rng(0).standard_normal(200_000))
    assert correlation_length(series) == pytest.approx((1.0 + rho) / (1.0 - rho), rel=0.1)


def test_correlated_rows_are_worth_less() -> None:
    """The covariance is σ² τ (HᵀH)⁻¹, for a joint of noise σ whose residuals repeat over τ samples."""
    H, y = np.random.default_rng(1).standard_normal((2, 40, 3))
    rows = Rows(("x", "y", "z", LAG), np.column_stack([H, np.zeros(40)]), y[:, 0])
    information = Information.of([rows], rows.columns)
    gathered = Gathered((information,), {"knee": 0.5}, {"knee": 9.0}, {})
    np.testing.assert_allclose(gathered.whitened({}).covariance(), 0.25 * 9.0 * np.linalg.inv(H.T @ H), rtol=1e-9)


def autoregressive(rho: float, size: int, rng: np.random.Generator) -> np.ndarray:
    """Of unit variance."""
    return np.asarray(lfilter([np.sqrt(1.0 - rho**2)], [1.0, -rho], rng.standard_normal(size)))


@pytest.mark.parametrize(("term", "residual"), [(0.0, 0.0), (0.9, 0.0), (0.9, 0.9), (0.95, 0.8)])
def test_independent_rows_tell_the_spread_of_a_terms_estimate(term: float, residual: float) -> None:
    """Of Σ x r / Σ x² over many draws; a correlated residual costs nothing if the term is not correlated with it."""
    rng, n, draws = np.random.default_rng(3), 4000, 300
    x = [autoregressive(term, n, rng) for _ in range(draws)]
    r = [autoregressive(residual, n, rng) for _ in range(draws)]
    spread = np.var([xi @ ri / (xi @ xi) for xi, ri in zip(x, r, strict=True)])
    worth = np.mean([independent_rows(ri, xi[:, None]) for xi, ri in zip(x, r, strict=True)])
    own = np.mean([correlation_length(ri) for ri in r])
    assert worth >= own
    assert worth == pytest.approx(max(own, n * spread), rel=0.25)


def test_a_friction_law_that_is_not_the_drives_leaves_fewer_independent_rows() -> None:
    """The chirp's residual follows its speed: white by its own correlation, but not to the viscous term."""
    rng, time = np.random.default_rng(5), np.arange(4000) / 100.0
    speed = np.cos(2.0 * np.pi * (0.1 + 0.04 * time) * time) * (0.5 + time / 20.0)
    white = 0.02 * rng.standard_normal(len(time))
    law = np.column_stack([np.tanh(speed / 0.02), speed])
    torque = 0.5 * law[:, 0] + 0.2 * speed - 0.1 * np.tanh(speed / 0.02) * np.exp(-np.abs(speed) / 0.5)
    exact, worn = (t - law @ np.linalg.lstsq(law, t, rcond=None)[0] for t in (law @ [0.5, 0.2] + white, torque + white))
    assert independent_rows(exact, law) < 1.5
    assert independent_rows(worn, law) > 1.5 * max(independent_rows(exact, law), correlation_length(worn))
