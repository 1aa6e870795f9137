"""What the rows of loaded legs tell about the errors of the model, against dense least squares, and what not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from layout import ERRORS, LAYOUT, LEARNT, PLACES, rows_of
from stadera.robot import load_robot
from stadera.trunk.block_rows import WeightedRows
from stadera.trunk.error_model import ErrorModel
from stadera.trunk.joint_errors import Errors
from stadera.trunk.segment import RowSums, Segment
from stadera.trunk.settings import ModelErrors, SwingDetection
from stadera.trunk.swing import SwingJoints

MODEL = ErrorModel(load_robot("hyq"), ModelErrors())


def test_rows_of_a_robot_that_never_lifted_a_leg_do_not_say_that_its_joints_cannot_stick() -> None:
    """Noise that passes for sliding in all directions would show no friction at all, and very surely."""
    model = ErrorModel(load_robot("hyq"), ModelErrors())
    remainder = np.zeros((1 + ERRORS, 1 + ERRORS))
    coulomb = np.arange(PLACES["coulomb"].start, PLACES["coulomb"].stop)
    remainder[1 + coulomb, 1 + coulomb] = 1e6
    errors = Errors(
        model, SwingJoints(model, SwingDetection()), np.full(ERRORS, 0.5), RowSums(remainder, remainder, 100.0, 5.0)
    )
    usual = np.sqrt(np.diag(model.covariance))
    assert (errors.std[coulomb] < 0.01 * usual[coulomb]).all()
    assert errors.std[PLACES["stiction"]] == pytest.approx(model.held * usual[coulomb])


@pytest.mark.parametrize("moved", [False, True], ids=["at rest", "after swings"])
def test_joints_whose_friction_is_known_stick_all_the_same(moved: bool) -> None:
    """Identified friction is subtracted while a joint slides, and holds up to its whole size while it does not."""
    robot = load_robot("hyq")
    joints = [joint for leg in robot.legs for joint in leg.joints]
    known = robot.with_dynamics({joint: replace(robot.dynamics[joint], coulomb=5.0) for joint in joints})
    model = ErrorModel(known, ModelErrors(coulomb=1e-3, stated=0.0))
    swing = SwingJoints(model, SwingDetection())
    if moved:
        terms = np.tile(np.array([[0.0], [1.0], [1.0], [0.0], [1.0]]), 12)
        swing.add(np.ones(4, dtype=bool), terms, np.zeros(12), np.zeros(12), np.full(12, 0.1), np.zeros(12))
    rows = RowSums(*np.zeros((2, 1 + ERRORS, 1 + ERRORS)), 100.0, 5.0)
    for summed in (None, rows):
        errors = Errors(model, swing, None, summed)
        assert errors.std[PLACES["stiction"]] == pytest.approx(model.held * 5.0, rel=0.01)


def rows_with(p: np.ndarray, noise: float, rng: np.random.Generator, blocks: int = 200) -> list[WeightedRows]:
    """Random rows of a trunk, whose model errors p have effects of about one standard deviation."""
    usual, theta = np.sqrt(np.diag(MODEL.covariance)), rng.standard_normal(10)
    out = []
    for k in range(blocks):
        A, C = rng.standard_normal((6, 10)), rng.standard_normal((6, ERRORS)) / usual
        C[:, PLACES["stiction"]] *= np.arange(12) % 2  # every other joint moves
        b = A @ theta + C @ p + noise * rng.standard_normal(6)
        out.append(rows_of(0.02 * k, A, C, b, 6.0 * noise**2))
    return out


def test_errors_and_their_covariance_are_those_of_dense_least_squares_with_considered_errors() -> None:
    """One system of trunk and errors with unit priors; what is considered adds its effect on the estimate."""
    rng, noise, repeated = np.random.default_rng(5), 2.0, 7.0
    usual = np.sqrt(np.diag(MODEL.covariance))
    made = rows_with(usual * rng.standard_normal(ERRORS) * (np.arange(ERRORS) < LEARNT.stop), noise, rng)
    segment = Segment.prior(np.zeros(10), np.full(10, 1e4), LAYOUT)
    for r in made:
        segment = segment.add(r)
    swing = SwingJoints(MODEL, SwingDetection())
    found = Errors(MODEL, swing, None, RowSums.of((segment,), repeated))

    k = LEARNT.stop
    prior = MODEL.covariance.copy()
    gain = PLACES["gain"]
    prior[gain, gain] -= prior[gain, gain].mean(axis=0)
    values, vectors = np.linalg.eigh(prior[:k, :k])
    F = vectors * np.sqrt(np.maximum(values, 0.0))
    rest = Errors(MODEL, swing).covariance[k:, k:]
    rest[:12, :12] *= np.outer(*2 * [found.std[k : k + 12] / np.sqrt(np.diag(rest)[:12])])
    X = np.vstack([np.hstack([1e4 * r.columns[:, :10], r.columns[:, 11 : 11 + k] @ F]) for r in made])
    b, C = np.concatenate([r.columns[:, 10] for r in made]), np.vstack([r.columns[:, 11 + k :] for r in made])
    x = np.zeros(X.shape[1])
    for loud in (repeated * np.mean((b - X[:, :10] @ np.linalg.lstsq(X[:, :10], b, rcond=None)[0]) ** 2), None):
        loud = loud or repeated * np.mean((b - X @ x) ** 2)
        inverse = np.linalg.inv(X.T @ X / loud + np.eye(len(x)))
        x = inverse @ X.T @ b / loud
    unit = np.zeros((k, len(x)))
    unit[:, 10:] = F
    by_rest = unit @ inverse @ X.T @ C / loud
    np.testing.assert_allclose(found.mean[:k] / usual[:k], (unit @ x) / usual[:k], rtol=1e-4, atol=1e-5)
    own = unit @ inverse @ unit.T + by_rest @ rest @ by_rest.T
    size = np.sqrt(np.diag(own))
    np.testing.assert_allclose(found.covariance[:k, :k] / np.outer(size, size), own / np.outer(size, size), atol=1e-4)
    across = np.outer(size, np.sqrt(np.diag(rest)))
    np.testing.assert_allclose(found.covariance[:k, k:] / across, -by_rest @ rest / across, atol=1e-4)
    assert np.linalg.eigvalsh(found.covariance / np.outer(found.std, found.std)).min() > -1e-9


def test_gains_cannot_take_up_what_all_torques_have_in_common() -> None:
    """Noise of the torques is in the target and in the gains' columns: a free mean would explain it by a lighter robot.
    Here the vertical force is the sum of twelve noisy torques.
    """
    rng, segment, weight = np.random.default_rng(3), Segment.prior(np.zeros(10), np.full(10, 1e3), LAYOUT), 100.0
    gain = np.arange(11 + PLACES["gain"].start, 11 + PLACES["gain"].stop)
    for k in range(3000):
        columns = np.zeros((6, 11 + ERRORS))
        torques = weight / 12.0 + 2.0 * rng.standard_normal(12)
        columns[2, 0], columns[2, 10], columns[2, gain] = 1.0, torques.sum(), torques
        segment = segment.add(WeightedRows(0.02 * k, columns, 1.0))
    errors = Errors(MODEL, SwingJoints(MODEL, SwingDetection()), None, RowSums.of((segment,), 10.0))
    assert abs(errors.mean[PLACES["gain"]].mean()) < 1e-12
    assert segment.mean(errors.mean)[0] == pytest.approx(weight, rel=0.002)


def test_errors_that_return_with_every_step_tell_no_more_however_often_they_return() -> None:
    """As many rows as `returning`, or ten times the same ones, leave the same mean and covariance."""
    rng, swing = np.random.default_rng(6), SwingJoints(MODEL, SwingDetection())
    steps = rows_with(np.sqrt(np.diag(MODEL.covariance)), 1.0, rng, blocks=80)
    once = often = Segment.prior(np.zeros(10), np.full(10, 1e6), LAYOUT)
    for k in range(10):
        for r in steps:
            once, often = (once if k else once.add(r)), often.add(r)
    first, again = (Errors(MODEL, swing, None, RowSums.of((s,), 10.0, 80.0)) for s in (once, often))
    np.testing.assert_allclose(again.mean / MODEL.variance**0.5, first.mean / MODEL.variance**0.5, atol=1e-3)
    np.testing.assert_allclose(again.std, first.std, rtol=1e-3)
    surer = Errors(MODEL, swing, None, RowSums.of((often,), 10.0))
    assert surer.std[PLACES["offset"]].max() < 0.7 * first.std[PLACES["offset"]].max()


def test_a_robot_at_rest_tells_nothing_of_its_model() -> None:
    """Only blocks in which at least half of the joints move count, and they alone as many as they are."""
    rng, swing = np.random.default_rng(4), SwingJoints(MODEL, SwingDetection())
    moving = rows_with(np.sqrt(np.diag(MODEL.covariance)), 1.0, rng, blocks=60)
    still = [replace(r, columns=r.columns.copy()) for r in rows_with(np.zeros(ERRORS), 1.0, rng, blocks=60)]
    for r in still:
        r.columns[:, 11 + PLACES["stiction"].start : 11 + PLACES["stiction"].stop] = 1.0
    alone = resting = Segment.prior(np.zeros(10), np.full(10, 1e4), LAYOUT)
    for r in moving:
        alone = alone.add(r)
    for r in still:
        resting = resting.add(r)
    unknown = Errors(MODEL, swing)
    at_rest = Errors(MODEL, swing, None, RowSums.of((resting,), 10.0))
    np.testing.assert_array_equal(at_rest.mean, unknown.mean)
    np.testing.assert_array_equal(at_rest.std, unknown.std)
    both = RowSums.of((alone, resting), 10.0)
    np.testing.assert_allclose(both.in_motion, alone.remainder, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(both.remainder, alone.remainder + resting.remainder, rtol=1e-9, atol=1e-9)
    assert both.moved == 60.0


@pytest.mark.parametrize("seed", range(5))
def test_energies_are_those_of_the_sampling_error_and_of_the_others_without_it(seed: int) -> None:
    """tr D Σ splits into two parts that are both positive: one of sampling, which joints' estimates partly follow."""
    rng, sampling = np.random.default_rng(seed), PLACES["sampling"].start
    rows = rng.standard_normal((18, 1 + ERRORS))
    rows[:, 1:] /= np.sqrt(np.diag(MODEL.covariance))
    rows[:, 1 + sampling] -= 2.0 * rows[:, 1 + PLACES["torque_lag"].start] * np.sqrt(MODEL.variance[sampling])
    products = rows.T @ rows
    known = Errors(MODEL, SwingJoints(MODEL, SwingDetection()), None, RowSums(products, products, 3.0, 5.0))
    own, stated = known.energies(products)
    assert own + stated == pytest.approx(np.trace(products[1:, 1:] @ known.covariance))
    # with independent draws of all errors, of which that of sampling is taken out by regression
    draws = np.linalg.cholesky(known.covariance + 1e-12 * np.diag(MODEL.variance)) @ rng.standard_normal(
        (ERRORS, 20000)
    )
    rest = draws - np.outer(draws @ draws[sampling] / (draws[sampling] @ draws[sampling]), draws[sampling])
    energy = np.square(rows[:, 1:] @ rest).sum(axis=0)
    assert energy.mean() == pytest.approx(stated, rel=0.05)
    assert 0.0 < own < products[1 + sampling, 1 + sampling]
