"""Sizes of error bars, from both sides: each against sums written out here, so that one too wide fails as well."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from layout import ERRORS, LAYOUT, PLACES
from stadera.information import Information, Unknowns
from stadera.robot import load_robot
from stadera.trunk.block_rows import WeightedRows
from stadera.trunk.error_model import ErrorModel
from stadera.trunk.fit import Fit
from stadera.trunk.joint_errors import Errors
from stadera.trunk.load import centre_slope
from stadera.trunk.segment import RowSums, Segment
from stadera.trunk.settings import ModelErrors, SwingDetection
from stadera.trunk.swing import SwingJoints

ROBOT = load_robot("hyq")
MODEL = ErrorModel(ROBOT, ModelErrors())
SWING = SwingDetection()


def errors(rows: RowSums | None = None) -> Errors:
    return Errors(MODEL, SwingJoints(MODEL, SWING), rows=rows)


def drawn(seed: int, blocks: int = 40, still: int = 0) -> list[WeightedRows]:
    """Random rows; the first `still` joints do not move."""
    rng, out = np.random.default_rng(seed), []
    for k in range(blocks):
        columns = rng.standard_normal((6, 11 + ERRORS))
        columns[:, 11 + PLACES["stiction"].start : 11 + PLACES["stiction"].stop] *= np.arange(12) < still
        out.append(WeightedRows(0.02 * k, columns, 1.0))
    return out


def summed(rows: list[WeightedRows], keep: float = 1.0) -> Segment:
    segment = Segment.prior(np.zeros(10), np.full(10, 1e4), LAYOUT)
    for each in rows:
        segment = segment.add(each, keep)
    return segment


def test_gains_have_a_mean_of_zero_and_no_more() -> None:
    """σ² (1 - 1 1ᵀ / 12): each gain keeps 11/12 of its variance, and the mean none."""
    gain = errors().covariance[PLACES["gain"], PLACES["gain"]]
    size = ModelErrors().gain ** 2
    assert np.diag(gain) == pytest.approx(size * 11.0 / 12.0)
    assert np.ones(12) @ gain @ np.ones(12) == pytest.approx(0.0, abs=1e-12)


def test_static_friction_is_as_large_as_friction_and_what_is_unknown_of_it() -> None:
    """After swings: held² ((dry + mean)² + variance of Coulomb friction)."""
    joints = [joint for leg in ROBOT.legs for joint in leg.joints]
    dynamics = {joint: replace(ROBOT.dynamics[joint], coulomb=1.0) for joint in joints}
    model = ErrorModel(ROBOT.with_dynamics(dynamics), ModelErrors())
    swing = SwingJoints(model, SWING)
    terms = np.tile(np.array([[0.0], [1.0], [1.0], [0.0], [1.0]]), 12)
    swing.add(np.ones(4, dtype=bool), terms, np.zeros(12), np.zeros(12), np.full(12, 0.1), np.zeros(12))
    found, coulomb = Errors(model, swing), PLACES["coulomb"]
    spread = np.diag(found.covariance)[coulomb]
    assert (spread > 0.2).all()
    expected = ModelErrors().held ** 2 * ((1.0 + found.mean[coulomb]) ** 2 + spread)
    assert np.diag(found.covariance)[PLACES["stiction"]] == pytest.approx(expected, rel=1e-9)


def test_static_friction_of_legs_that_never_swing_is_as_large_as_the_prior_allows() -> None:
    dynamics = {j: replace(ROBOT.dynamics[j], coulomb=1.0) for leg in ROBOT.legs for j in leg.joints}
    model = ErrorModel(ROBOT.with_dynamics(dynamics), ModelErrors())
    found = Errors(model, SwingJoints(model, SWING))
    expected = ModelErrors().held ** 2 * (1.0 + model.variance[PLACES["coulomb"]])
    assert (model.variance[PLACES["coulomb"]] > 0.2).all()
    assert np.diag(found.covariance)[PLACES["stiction"]] == pytest.approx(expected, rel=1e-9)


def test_friction_and_noise_do_not_cancel_between_two_loads_and_all_else_does() -> None:
    """With K the sensitivities: D Σ Dᵀ of what lasts, K₁ C K₁ᵀ + K₂ C K₂ᵀ of what is another one under each load."""
    first, second, known = summed(drawn(1)), summed(drawn(2)), errors()
    changing = np.zeros((ERRORS, ERRORS))
    stuck = PLACES["stiction"]
    changing[stuck, stuck] = known.covariance[stuck, stuck]
    K1, K2 = (s.solution[:, 1:] for s in (first, second))
    lasting = (K2 - K1) @ (known.covariance - changing) @ (K2 - K1).T
    expected = lasting + K1 @ changing @ K1.T + K2 @ changing @ K2.T
    found = known.difference_covariance(first, second) - known.of_rows(first) - known.of_rows(second)
    scale = np.sqrt(np.diag(expected))
    np.testing.assert_allclose(found / np.outer(scale, scale), expected / np.outer(scale, scale), atol=1e-9)


def test_friction_beyond_its_law_is_a_share_of_what_it_corrects() -> None:
    """ε u, u what a load's mass and moments would be without friction less what they are."""
    known = errors(RowSums.of([summed(drawn(1, blocks=60))], 10.0))
    first, second = summed(drawn(1)), summed(drawn(2))
    smooth = known.mean.copy()
    smooth[PLACES["coulomb"]] = smooth[PLACES["load_friction"]] = 0.0
    u = [(second.mean(p) - first.mean(p)) for p in (smooth, known.mean)]
    found = known.by_law(second.sensitivity - first.sensitivity)
    assert np.abs(found).max() > 0.003
    np.testing.assert_allclose(found, ModelErrors().friction_law * (u[0] - u[1]), atol=1e-9)


def test_what_lasts_under_another_load_is_a_covariance() -> None:
    """Without what may change goes what other errors have in common with it."""
    model = ErrorModel(ROBOT, ModelErrors())
    rows = RowSums.of([summed(drawn(1, blocks=60, still=5))], 10.0)
    known = Errors(model, SwingJoints(model, SWING), rows=rows)
    own = np.sqrt(np.maximum(np.diag(known.covariance), 1e-300))
    values = np.linalg.eigvalsh(known.lasting / np.outer(own, own))
    assert values.min() > -1e-9


def test_what_earlier_rows_left_is_forgotten_with_them() -> None:
    """The products of n blocks, each kept by a factor for every later one, sum to those of weighted rows."""
    keep, rows = 0.8, drawn(3, blocks=30)
    segment = summed(rows, keep)
    scale = np.sqrt(keep) ** np.arange(len(rows) - 1, -1, -1)
    A = np.vstack([s * r.columns[:, :10] for s, r in zip(scale, rows, strict=True)])
    B = np.vstack([s * r.columns[:, 10:] for s, r in zip(scale, rows, strict=True)])
    left = B - A @ np.linalg.lstsq(A, B, rcond=None)[0]
    np.testing.assert_allclose(segment.remainder, left.T @ left, rtol=1e-3, atol=1e-3 * np.abs(left.T @ left).max())


@pytest.mark.parametrize(("still", "moves"), [(6, True), (7, False)])
def test_a_robot_moves_if_at_least_half_of_its_joints_do(still: int, moves: bool) -> None:
    (rows,) = drawn(4, blocks=1, still=still)
    assert Segment.prior(np.zeros(10), np.ones(10), LAYOUT).moves(rows) is moves


def test_sampling_errors_lie_in_the_middle_between_none_and_their_largest() -> None:
    white, largest, stated = 10.0, 90.0, 40.0
    products = np.zeros((1 + ERRORS, 1 + ERRORS))
    at = 1 + PLACES["sampling"].start
    products[at, at], products[0, 0] = largest, 300.0
    offset = 1 + np.arange(PLACES["offset"].start, PLACES["offset"].stop)
    products[offset, offset] = stated / 12.0 / MODEL.variance[PLACES["offset"]]
    found = Fit.of(RowSums(products, products, 0.0, 10.0, white), errors())
    assert found.misfit == pytest.approx(300.0 / (0.5 * (white + largest) + stated), rel=1e-6)


def test_centres_follow_first_moments_and_masses() -> None:
    """c = h / m, by differences."""
    moments = np.array([8.0, -1.6, 0.8, 1.2])
    for k in range(4):
        step = np.zeros(4)
        step[k] = 1e-6
        low, high = (np.array([m[0], *m[1:] / m[0]]) for m in (moments - step, moments + step))
        np.testing.assert_allclose(centre_slope(moments)[:, k], (high - low) / 2e-6, atol=1e-7)


def test_considered_errors_are_not_forgotten_with_the_rows() -> None:
    """Less weight for all rows changes neither the estimate nor what a considered error does to it."""
    rng = np.random.default_rng(9)
    rows, considered = rng.standard_normal((20, 3)), rng.standard_normal((20, 2))
    known = Information.empty(Unknowns.of(x=3), 2).add(rows, rng.standard_normal(20), considered)
    later = known.forget(0.25)
    np.testing.assert_allclose(later.mean, known.mean, atol=1e-12)
    own = np.linalg.inv(rows.T @ rows)
    moved = own @ rows.T @ considered
    np.testing.assert_allclose(known.covariance(), own + moved @ moved.T, atol=1e-12)
    np.testing.assert_allclose(later.covariance(), own / 0.25 + moved @ moved.T, atol=1e-12)
