"""Draws are the Gaussian posterior where nothing is impossible, and what rejection leaves of it where something is."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from identify.leg_runs import hyq, noisy, run
from stadera.errors import IdentificationError, RecordingError
from stadera.identify.draws import drawn
from stadera.identify.legs import identify
from stadera.identify.result import Identification
from stadera.identify.settings import IdentifySettings
from stadera.identify.solutions import Estimate, signed
from stadera.inertia import PSEUDO_BASIS
from stadera.types import Array, Bools


@pytest.fixture(scope="module")
def result() -> Identification:
    return identify(hyq(), noisy(run(), 0.3), IdentifySettings(legs=("RH",)))


def possible(estimate: Estimate, values: Array) -> Bools:
    """`is_physical` of all at once, of some as it is."""
    prior = estimate.prior
    bodies = np.array([values[:, prior.block(link)] for link in prior.links])
    least = np.linalg.eigvalsh(np.tensordot(bodies, PSEUDO_BASIS, axes=1))[..., 0].min(axis=0)
    found = (least >= 0.0) & (values[:, signed(prior)] >= 0.0).all(axis=1)
    assert [replace(estimate, values=value).is_physical for value in values[:500]] == found[:500].tolist()
    return found


def test_draws_are_what_rejection_leaves_of_the_gaussian(result: Identification) -> None:
    estimate, rng = result.legs[0].estimate, np.random.default_rng(0)
    found = drawn(estimate, 1500, rng)
    assert possible(estimate, found).all()
    gaussian = rng.multivariate_normal(estimate.values, estimate.covariance, 20_000, method="eigh")
    kept = gaussian[possible(estimate, gaussian)]
    assert 500 < len(kept) < len(gaussian)
    std = kept.std(axis=0)
    error = np.sqrt(1.0 / len(kept) + 1.0 / len(found))
    assert np.abs((found.mean(axis=0) - kept.mean(axis=0)) / std).max() < 4.5 * error
    ratio = found.std(axis=0) / std
    assert ratio.min() > 0.88
    assert ratio.max() < 1.14
    apart = np.corrcoef(found.T) - np.corrcoef(kept.T)
    assert np.abs(apart).max() < 6.0 * error


def test_draws_are_a_table_with_all_parameters(result: Identification, tmp_path: Path) -> None:
    import pyarrow.parquet as parquet

    table = result.draws(20, seed=3)
    assert list(table) == list(result.legs[0].parameters)
    result.save_draws(tmp_path / "draws.parquet", 20, seed=3)
    read = parquet.read_table(tmp_path / "draws.parquet")
    assert read.num_rows == 20
    np.testing.assert_array_equal(read.column(5).to_numpy(), list(table.values())[5])
    with pytest.raises(RecordingError):
        result.save_draws(tmp_path / "draws.txt")
    with pytest.raises(IdentificationError):
        result.draws(0)


def test_what_has_no_variance_is_the_estimate_s(result: Identification) -> None:
    estimate = result.legs[0].estimate
    values, covariance = estimate.values.copy(), estimate.covariance.copy()
    own = np.arange(len(values))[estimate.prior.block(estimate.prior.links[0])]
    values[own[1:]] = 0.0  # a point mass, at the border of what is possible
    covariance[own] = covariance[:, own] = 0.0
    found = drawn(replace(estimate, values=values, covariance=covariance), 5, np.random.default_rng(0))
    np.testing.assert_allclose(found[:, own], np.tile(values[own], (5, 1)), rtol=1e-12, atol=1e-12)
    assert (np.delete(found, own, axis=1).std(axis=0) > 0.0).all()
