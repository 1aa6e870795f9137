"""The benchmark of limits: its floor against Monte Carlo, and its model of errors against the test-bed's."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "benchmarks"))
pytest.importorskip("mujoco")

from limits import Best, LimitSettings, best_of, tables
from limits_rows import LogRows
from limits_truth import ErrorLaw, Truths, law_of_errors, true_errors, true_trunks, usual_errors

from layout import ERRORS, PLACES
from stadera.inertia import InertialParameters
from stadera.lab.experiments.reality import RealityCase
from stadera.lab.reality.draw import REAL_SETS, drawn
from stadera.lab.scenarios import catalog
from stadera.lab.scenarios.catalog import SimulateSettings
from stadera.lab.scenarios.run import simulate
from stadera.robot import load_robot
from stadera.robot.stance import standing_configuration
from stadera.trunk.samples import Samples
from stadera.trunk.settings import TrunkSettings
from stadera.types import Array

MASS = 15.0  # kg
NONE = np.zeros((0, 2), dtype=int)


def test_the_covariance_of_the_best_estimate_is_the_spread_of_its_errors() -> None:
    rng = np.random.default_rng(0)
    X = rng.standard_normal((12, 6)) * [3.0, 1.0, 1.0, 0.3, 0.1, 0.0]
    x, e = rng.standard_normal((20_000, 6)), rng.standard_normal((20_000, 12))
    errors = np.array([Best.of(X, y).value for y in x[:2000] @ X.T + e[:2000]]) - x[:2000]
    expected = Best.of(X, X[:, 0]).covariance
    assert np.abs(np.cov(errors.T) - expected).max() < 0.08
    assert expected[5, 5] == pytest.approx(1.0)  # of an unknown without a column, the prior


@pytest.fixture(scope="module")
def synthetic() -> tuple[LogRows, ErrorLaw]:
    """Random rows over ten seconds, and errors of three kinds."""
    rng, blocks = np.random.default_rng(1), 60
    A, C = rng.standard_normal((blocks, 6, 10)), np.zeros((blocks, 6, ERRORS))
    A[:, :3, 0] += [0.0, 0.0, 9.81]
    C[:, :, PLACES["gain"]] = rng.standard_normal((blocks, 6, 12)) + 3.0 * rng.standard_normal((6, 12))
    factor = np.zeros((ERRORS, 12))
    factor[PLACES["gain"]] = 0.5 * np.eye(12)
    rows = LogRows(np.linspace(0.5, 9.5, blocks), A, C, np.zeros((blocks, 6)), np.zeros((0, ERRORS)), np.zeros(0), NONE)
    return rows, ErrorLaw(np.zeros(ERRORS), factor, np.zeros((ERRORS, 12)))


def measured(rows: LogRows, truth: Truths, rng: np.random.Generator) -> LogRows:
    """The rows with targets of a truth, and unit noise."""
    loaded = (rows.time > 5.0)[:, None]
    target = rows.matrix @ truth.trunk + (rows.matrix @ truth.load) * loaded + rows.errors @ truth.errors
    return replace(rows, target=target + rng.standard_normal(target.shape))


def test_floor_is_the_spread_of_the_best_estimates_errors(synthetic: tuple[LogRows, ErrorLaw]) -> None:
    rows, law = synthetic
    rng, settings = np.random.default_rng(2), LimitSettings(repeated=1.0)
    trunk = np.array([10.0, 0.3, -0.2, 0.5, 0.1, 0.0, 0.0, 0.3, 0.0, 0.3])
    load = np.array([2.0, 0.1, 0.1, 0.4, 0.1, 0.0, 0.0, 0.1, 0.0, 0.1])
    ratios = []
    for _ in range(60):
        truth = Truths(trunk, load, law.factor @ rng.standard_normal(12))
        errors, floor = best_of(measured(rows, truth, rng), truth, law, MASS, settings)
        ratios.append(errors / floor)
    rms = np.sqrt(np.mean(np.square(ratios), axis=0))
    assert (rms > 0.75).all()  # the standard error of each is 0.09
    assert (rms < 1.3).all()


def test_without_an_error_the_floor_is_lower(synthetic: tuple[LogRows, ErrorLaw]) -> None:
    rows, law = synthetic
    truth = Truths(np.eye(10)[0] * 10.0, np.eye(10)[0], np.zeros(ERRORS))
    rows = measured(rows, truth, np.random.default_rng(3))
    some, none = replace(law, factor=law.factor.copy()), replace(law, factor=np.zeros((ERRORS, 12)))
    some.factor[:, :6] = 0.0
    settings = LimitSettings(repeated=1.0)
    floors = [best_of(rows, truth, one, MASS, settings)[1] for one in (law, some, none)]
    assert (floors[0] > floors[1]).all()
    assert (floors[1] > floors[2]).all()


def at_rest(joints: Array) -> Samples:
    """Ten samples of a robot that stands."""
    still = np.zeros((10, len(joints)))
    force = np.tile([0.0, 0.0, 9.81], (10, 1))
    return Samples(0.02 * np.arange(10), still + joints, still, still, np.zeros((10, 3)), force)


def test_law_of_errors_is_that_of_the_test_beds_draws() -> None:
    robot, sizes = load_robot("hyq"), replace(REAL_SETS["real"], noise=(1.5, 1.5), quantised=0.0)
    samples = at_rest(standing_configuration(robot)[-12:])
    found = np.array([true_errors(robot, drawn(robot, sizes, seed).to_dict(), samples) for seed in range(400)])
    law = law_of_errors(robot, sizes, drawn(robot, sizes, 0).to_dict(), found[0])
    expected = np.sqrt((law.factor**2).sum(axis=1))
    constant = np.setdiff1d(np.arange(ERRORS), np.r_[PLACES["stiction"]])
    varied = constant[expected[constant] > 0.0]
    assert not found[:, np.setdiff1d(constant, varied)].any()
    ratio = found[:, varied].std(axis=0) / expected[varied]
    assert np.sqrt(np.mean(ratio**2)) == pytest.approx(1.0, abs=0.05)
    assert ratio.min() > 0.75
    assert ratio.max() < 1.25
    assert (np.abs(found[:, varied].mean(axis=0) - law.mean[varied]) < 0.3 * expected[varied]).all()


def test_true_errors_explain_the_rows_of_a_trot(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each kind has the right columns and sign: without it, or with the opposite sign, more is left."""
    robot = load_robot("hyq")
    monkeypatch.setattr(catalog, "REAL_SETS", {"real-unit-gain": replace(REAL_SETS["real-unit-gain"], varying=None)})
    run = simulate(robot, "trot", SimulateSettings("real-unit-gain", duration=2.5, seed=5, hold=2, rate=500.0))
    samples, (trunk, _) = Samples.of_recording(run.recording, robot), true_trunks(run.truth)
    assert run.truth.drawn is not None
    p = true_errors(robot, run.truth.drawn, samples)
    rows = LogRows.of(robot, samples, InertialParameters(trunk), p, TrunkSettings())
    rows = rows.chosen(rows.time > 0.5)
    assert len(rows.swing) > 60

    def left(errors: Array) -> tuple[float, float]:
        e = rows.target - rows.matrix @ trunk - rows.errors @ errors
        air = rows.swing_target - rows.swing @ errors
        return float(np.sqrt(np.mean(e**2))), float(np.median(np.abs(air)))

    exact, nothing = left(p), left(np.zeros(ERRORS))
    assert exact[0] < 0.5 * nothing[0]
    assert exact[1] < 0.3 * nothing[1]
    for name in ("rotor", "viscous", "coulomb", "offset", "gain", "encoder", "contact", "torque_lag", "imu_rotation"):
        opposite = p.copy()
        opposite[PLACES[name]] *= -1.0
        assert left(opposite)[0] > exact[0], name
    for name in ("rotor", "viscous", "coulomb", "offset", "gain", "torque_lag", "link_com"):
        opposite = p.copy()
        opposite[PLACES[name]] *= -1.0
        assert left(opposite)[1] > exact[1], name


def test_usual_errors_are_those_of_the_estimator() -> None:
    robot = load_robot("go2")
    alone, common = (usual_errors(robot, REAL_SETS[name]) for name in ("real-unit-gain", "real"))
    gain = PLACES["gain"]
    own = alone.factor[gain] @ alone.factor[gain].T
    assert np.diag(own) == pytest.approx(0.03**2 * 11.0 / 12.0)
    np.testing.assert_allclose(own.sum(axis=0), 0.0, atol=1e-15)  # their mean is zero
    assert np.diag(common.factor[gain] @ common.factor[gain].T) == pytest.approx(0.03**2 * 23.0 / 12.0)
    assert not alone.factor[PLACES["stiction"]].any()


def test_tables_leave_out_what_is_not_observed_and_robots_that_fell() -> None:
    figures = {name: [1.0, 3.0, 4.0, None, 0.5, None, None, None] for name in ("floor", "best", "joint", "weigh")}
    run = {**figures, "shares": {"gain": figures["floor"]}, "detection": 6.0}
    case = RealityCase("go2", "trot", 0.05, "real", 0)
    found = tables([(case, run), (case, {"fell": "it did"})])
    floors, shares, detection = ([cell.text for cell in table.groups[0][1][0]] for table in found)
    assert floors == ["floor", "1; 1", "3; 3", "4; 4", "5; 5", "–", "0.5; 0.5", "–"]
    assert shares == ["gain", "1", "3", "4", "5", "–", "0.5", "–"]
    assert detection == ["6.0", "6.0 to 6.0", "100%"]
