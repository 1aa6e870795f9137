"""Correlated residuals: how many samples count as one, and that information is worth so much less."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from stadera.identify.gather import Gathered
from stadera.identify.residuals import correlation_length
from stadera.information import Information, Unknowns


@pytest.mark.parametrize("rho", [0.0, 0.5, 0.9])
def test_an_autoregressive_series_has_its_correlation_length(rho: float) -> None:
    """Of x_k = ρ x_k-1 + w_k: 1 + 2 Σ ρ^k = (1 + ρ) / (1 - ρ)."""
    series = lfilter([1.0], [1.0, -rho], np.random.default_rng(0).standard_normal(200_000))
    assert correlation_length(series) == pytest.approx((1.0 + rho) / (1.0 - rho), rel=0.1)


def test_correlated_rows_are_worth_less() -> None:
    """The covariance is σ² τ (HᵀH)⁻¹, for a joint of noise σ whose residuals repeat over τ samples."""
    H, y = np.random.default_rng(1).standard_normal((2, 40, 3))
    information = Information.empty(Unknowns.of(x=3)).add(H, y[:, 0])
    gathered = Gathered((information,), {"knee": 0.5}, {"knee": 9.0}, {})
    np.testing.assert_allclose(gathered.whitened({}).covariance(), 0.25 * 9.0 * np.linalg.inv(H.T @ H), rtol=1e-9)
