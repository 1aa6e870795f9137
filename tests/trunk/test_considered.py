"""What the errors' covariance takes from the rows, and what it does not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from stadera.robot import load_robot
from stadera.trunk.considered import Errors, RowSums
from stadera.trunk.error_model import ERRORS, PLACES, ErrorModel
from stadera.trunk.settings import ModelErrors, SwingDetection
from stadera.trunk.swing import SwingJoints


def test_rows_of_a_robot_that_never_lifted_a_leg_do_not_say_that_its_joints_cannot_stick() -> None:
    """Noise that passes for sliding in all directions would show no friction at all, and very surely."""
    model = ErrorModel(load_robot("hyq"), ModelErrors(), 0.7)
    remainder = np.zeros((1 + ERRORS, 1 + ERRORS))
    coulomb = np.arange(PLACES["coulomb"].start, PLACES["coulomb"].stop)
    remainder[1 + coulomb, 1 + coulomb] = 1e6
    errors = Errors(model, SwingJoints(model, SwingDetection()), 0.5, RowSums(remainder, 100, 5.0))
    usual = np.sqrt(np.diag(model.covariance))
    assert (errors.std[coulomb] < 0.01 * usual[coulomb]).all()
    assert errors.std[PLACES["stiction"]] == pytest.approx(model.held * usual[coulomb])


@pytest.mark.parametrize("moved", [False, True], ids=["at rest", "after swings"])
def test_joints_whose_friction_is_known_stick_all_the_same(moved: bool) -> None:
    """Identified friction is subtracted while a joint slides, and holds up to its whole size while it does not."""
    robot = load_robot("hyq")
    joints = [joint for leg in robot.legs for joint in leg.joints]
    known = robot.with_dynamics({joint: replace(robot.dynamics[joint], coulomb=5.0) for joint in joints})
    model = ErrorModel(known, ModelErrors(coulomb=1e-3), 0.7)
    swing = SwingJoints(model, SwingDetection())
    if moved:
        terms = np.tile(np.array([[0.0], [1.0], [1.0], [1.0]]), 12)
        swing.add(np.ones(4, dtype=bool), terms, np.zeros(12), np.zeros(12), np.full(12, 0.1))
    rows = RowSums(np.zeros((1 + ERRORS, 1 + ERRORS)), 100, 5.0)
    for summed in (None, rows):
        errors = Errors(model, swing, 1.0, summed)
        assert errors.std[PLACES["stiction"]] == pytest.approx(model.held * 5.0, rel=0.01)


@pytest.mark.parametrize("seed", range(5))
def test_energies_are_those_of_the_sampling_error_and_of_the_others_without_it(seed: int) -> None:
    """tr D Σ splits into two parts that are both positive: one of sampling, which joints' estimates partly follow."""
    rng, model = np.random.default_rng(seed), ErrorModel(load_robot("hyq"), ModelErrors(), 0.7)
    sampling = PLACES["sampling"].start
    rows = rng.standard_normal((18, 1 + ERRORS))
    rows[:, 1:] /= np.sqrt(np.diag(model.covariance))
    rows[:, 1 + sampling] -= 2.0 * rows[:, 1 + PLACES["torque_lag"].start] * np.sqrt(model.variance[sampling])
    summed = RowSums(rows.T @ rows, 3, 5.0)
    known, products = Errors(model, SwingJoints(model, SwingDetection()), 1.0, summed).known, summed.remainder[1:, 1:]
    others, along = known.given(sampling)
    own = known.dense[sampling, sampling] * along @ products @ along
    assert np.linalg.eigvalsh(others.dense).min() > -1e-12
    assert others.dense + known.dense[sampling, sampling] * np.outer(along, along) == pytest.approx(known.dense)
    stated, doubled = others.explained(summed.remainder)
    assert stated + own == pytest.approx(np.trace(products @ known.dense))
    assert doubled == pytest.approx(float(np.einsum("ij,ji->", *[products @ others.dense] * 2)))
    assert stated > 0.0
    assert doubled > 0.0
    assert 0.0 < own < products[sampling, sampling]
