"""Sizes of the kinds of model errors: against the likelihood by its definition, and sizes that are known."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from layout import ERRORS, LAYOUT, PLACES
from stadera.robot import load_robot
from stadera.trunk.error_model import ErrorModel
from stadera.trunk.joint_errors import Errors
from stadera.trunk.segment import RowSums
from stadera.trunk.settings import ModelErrors, SwingDetection
from stadera.trunk.sizes import KINDS, Sizes
from stadera.trunk.swing import SwingJoints

SPREAD = 0.55
MODEL = ErrorModel(load_robot("hyq"), ModelErrors())
LEARNT = LAYOUT.learnt.stop


def rows_of(sizes: dict[str, float], rng: np.random.Generator, count: int = 800) -> tuple[np.ndarray, np.ndarray]:
    """A and c of rows of unit noise, in which errors of the prior's size, times `sizes` by kind, have drawn effects."""
    size = np.ones(LEARNT)
    for kind, factor in sizes.items():
        for name in KINDS[kind]:
            size[PLACES[name]] = factor
    C = rng.standard_normal((count, LEARNT)) * 0.3
    y = C @ (size * rng.standard_normal(LEARNT)) + rng.standard_normal(count)
    return C.T @ C, C.T @ y


def test_mean_size_of_one_kind_is_that_of_the_likelihood_by_its_definition() -> None:
    """Rows y = C p + e with p of covariance S², e of unit covariance: the density of y, times that of ln s, summed."""
    rng = np.random.default_rng(1)
    C = np.zeros((60, LEARNT))
    lag, response = PLACES["torque_lag"], PLACES["imu_response"]
    C[:, lag], C[:, response] = 0.3 * rng.standard_normal((60, 1)), 0.3 * rng.standard_normal((60, 3))
    y = 2.0 * C[:, lag][:, 0] + rng.standard_normal(60)
    found = Sizes(LAYOUT, SPREAD)
    found.update(C.T @ C, C.T @ y)
    tried = np.linspace(-6.0, 6.0, 400) * SPREAD - SPREAD**2
    known = C[:, response] @ C[:, response].T + np.eye(60)
    likely = [
        multivariate_normal(np.zeros(60), known + np.exp(2.0 * t) * C[:, lag] @ C[:, lag].T).logpdf(y) for t in tried
    ]
    weight = np.exp(np.array(likely) - max(likely) - 0.5 * (tried / SPREAD + SPREAD) ** 2)
    mean = weight @ np.exp(2.0 * tried) / weight.sum()
    assert found.by_kind["lag"] ** 4 == pytest.approx(mean, rel=1e-3)  # by half of the step of its logarithm


@pytest.mark.parametrize("seed", [0, 1, 2, 3, 4, 5])
def test_finds_which_kinds_are_small_and_which_are_large(seed: int) -> None:
    made = dict.fromkeys(KINDS, 1.0) | {"rotor": 0.2, "encoder": 0.3, "contact": 0.3, "friction": 2.5}
    normal, right = rows_of(made, np.random.default_rng(seed))
    found = Sizes(LAYOUT, SPREAD)
    for _ in range(12):
        found.update(normal, right)
    for kind in ("rotor", "encoder", "contact", "friction"):
        assert np.log(found.by_kind[kind]) == pytest.approx(np.log(made[kind]), abs=0.6)
    before = dict(found.by_kind)
    found.update(normal, right)
    assert found.by_kind == pytest.approx(before, rel=0.02)


def test_gains_are_never_larger_than_usual() -> None:
    normal, right = rows_of({"gain": 5.0}, np.random.default_rng(2))
    found = Sizes(LAYOUT, SPREAD)
    for _ in range(12):
        found.update(normal, right)
    assert found.by_kind["gain"] == 1.0


def test_kinds_that_no_row_shows_keep_their_size() -> None:
    found = Sizes(LAYOUT, SPREAD)
    found.update(np.zeros((LEARNT, LEARNT)), np.zeros(LEARNT))
    assert found.by_kind == pytest.approx(dict.fromkeys(KINDS, 1.0), abs=1e-3)
    found.by_kind["friction"] = 2.0
    assert (found.factors[PLACES["stiction"]] == 2.0).all()
    assert (found.factors[PLACES["common_gain"]] == 1.0).all()
    assert found.factors.shape == (ERRORS,)


def test_evidence_is_that_by_which_errors_are_estimated() -> None:
    """With L of the prior, p̂ = L (1 + A)⁻¹ c, so that hᵀ p̂ = cᵀ (1 + A)⁻¹ c."""
    rng, learnt, gain = np.random.default_rng(3), LAYOUT.learnt, PLACES["gain"]
    rows = rng.standard_normal((600, 1 + ERRORS))
    rows[:, 1:] /= np.sqrt(MODEL.variance)
    products = rows.T @ rows
    summed, swing = RowSums(products, products, 100.0, 10.0), SwingJoints(MODEL, SwingDetection())
    errors = Errors(MODEL, swing, None, summed)
    normal, right = errors.evidence(swing)
    start = MODEL.covariance[learnt, learnt].copy()
    start[gain, gain] -= MODEL.variance[gain].mean() / LAYOUT.joints
    repeated = np.trace(start @ products[1:, 1:][learnt, learnt]) / np.trace(normal)
    assert repeated >= 10.0 * 0.25
    along = float(products[1:, 0][learnt] @ errors.mean[learnt]) / repeated
    assert right @ np.linalg.solve(np.eye(LEARNT) + normal, right) == pytest.approx(along, rel=1e-6)
