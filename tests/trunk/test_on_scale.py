"""A robot on a scale: what its weight tells about trunk, payload and the scale of its torques."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
import typer

from layout import ERRORS, LAYOUT, PLACES, rows_of
from stadera import IdentificationError, TrunkEstimator, load_robot, weigh
from stadera.cli import parse
from stadera.inertia import InertialParameters
from stadera.lab.plant.sensors import STANDARD
from stadera.lab.scenarios.catalog import SimulateSettings
from stadera.lab.scenarios.run import simulate
from stadera.logs import Recording
from stadera.trunk import Samples
from stadera.trunk.error_model import ErrorModel
from stadera.trunk.joint_errors import Errors
from stadera.trunk.outside import Correction, Knowledge
from stadera.trunk.segment import Segment
from stadera.trunk.settings import ModelErrors, SwingDetection
from stadera.trunk.swing import SwingJoints
from stadera.weigh import Weighing
from walking import Walk, recorded, walked

HYQ = load_robot("hyq")
GAIN, LOAD = 1.04, 8.0  # of all torques; kg
TRUNK = HYQ.inertias[HYQ.trunk].mass


def summed(seed: int) -> Segment:
    rng = np.random.default_rng(seed)
    segment = Segment.prior(np.zeros(10), np.ones(10), LAYOUT)
    for k in range(40):
        segment = segment.add(rows_of(0.02 * k, *(rng.normal(size=s) for s in ((6, 10), (6, ERRORS), 6)), 1e-3))
    return segment


@pytest.mark.parametrize("alike", [0.0, 0.8])
def test_it_is_gaussian_conditioning(alike: float) -> None:
    """Against the joint covariance of trunk then, trunk now and what the scale says, built up densely."""
    errors = Errors(ErrorModel(HYQ, ModelErrors()), SwingJoints(ErrorModel(HYQ, ModelErrors()), SwingDetection()))
    then, now, links = summed(1), summed(2), np.zeros(ERRORS)
    links[PLACES["link_mass"]] = 2.0
    told = Correction(
        [Knowledge("", np.array([50.0]), np.array([[0.3**2]]), links[None], ((then, np.eye(1, 10)),))],
        errors,
        now,
        10.0,
        alike,
    )
    # unknowns: lasting errors, changing errors then and now, noise then and now
    changing = np.zeros(ERRORS, dtype=bool)
    changing[PLACES["stiction"]] = True
    size = 2 * ERRORS + 20
    joint = np.zeros((size, size))
    S = errors.covariance
    joint[:ERRORS, :ERRORS] = joint[ERRORS : 2 * ERRORS, ERRORS : 2 * ERRORS] = S
    joint[:ERRORS, ERRORS : 2 * ERRORS] = joint[ERRORS : 2 * ERRORS, :ERRORS] = np.where(
        np.outer(changing, changing), alike * S, S
    )
    for k, segment in enumerate((then, now)):
        noise = slice(2 * ERRORS + 10 * k, 2 * ERRORS + 10 * (k + 1))
        joint[noise, noise] = errors.of_rows(segment, 10.0)
    of_then, of_now = np.zeros((10, size)), np.zeros((10, size))
    of_then[:, :ERRORS], of_then[:, 2 * ERRORS : 2 * ERRORS + 10] = -then.sensitivity, np.eye(10)
    of_now[:, ERRORS : 2 * ERRORS], of_now[:, 2 * ERRORS + 10 :] = -now.sensitivity, np.eye(10)
    weighed = of_then[0].copy()
    weighed[:ERRORS] += links
    variance = weighed @ joint @ weighed + 0.3**2
    for segment, error in ((then, of_then), (now, of_now)):
        shared, own = error @ joint @ weighed, error @ joint @ error.T
        value, covariance, by_scale = told.of_trunks(
            {segment: np.eye(10)}, segment.mean(errors.mean), own, errors.by_scale(segment.sensitivity)
        )
        missing = 50.0 - then.mean(errors.mean)[0] - links @ errors.mean
        np.testing.assert_allclose(value, segment.mean(errors.mean) + shared * missing / variance, rtol=1e-9)
        posterior = own - np.outer(shared, shared) / variance
        np.testing.assert_allclose(covariance, posterior, rtol=1e-9, atol=1e-12)
        gain = np.zeros(size)
        gain[PLACES["common_gain"]] = 1.0  # the same then and now
        after = error @ joint @ gain - shared * (gain @ joint @ weighed) / variance
        left = gain @ joint @ gain - (gain @ joint @ weighed) ** 2 / variance
        np.testing.assert_allclose(by_scale, -after / np.sqrt(left), rtol=1e-7, atol=1e-12)


@cache
def loaded() -> Recording:
    """A walk with a load from 3 s on, the torques of all joints too large by `GAIN`."""
    load = InertialParameters.from_com(LOAD, (0.05, 0.0, 0.15), 0.1 * np.eye(3))
    walk = walked(HYQ, Walk(seconds=6.0, rate_hz=250.0, load=load, loaded_at=3.0))
    log = recorded(HYQ, walk, STANDARD, 2)
    return log.mapped(lambda name, values: GAIN * values if name == "effort" else values)


@cache
def tared() -> Weighing:
    return weigh(HYQ, loaded(), tare=(0.0, 2.8))


def test_a_scale_finds_the_scale_of_the_torques() -> None:
    without = tared()
    found = weigh(HYQ, loaded(), tare=(0.0, 2.8), weight=(HYQ.mass, 0.05))
    assert without.payload is not None
    assert found.payload is not None
    assert abs(without.mass - TRUNK - LOAD) > 0.02 * HYQ.mass  # torques that are 4 % too large
    assert found.mass == pytest.approx(TRUNK + LOAD, abs=0.01 * HYQ.mass)
    assert found.mass_std < 0.5 * without.mass_std
    assert abs(found.mass - TRUNK - LOAD) < 3.0 * found.mass_std
    assert abs(found.payload.mass - LOAD) < abs(without.payload.mass - LOAD)
    assert found.payload.mass_std < without.payload.mass_std
    assert (without.payload.scale or 0.0) == pytest.approx(ModelErrors().common_gain, rel=0.4)
    assert (found.payload.scale or 0.0) < 0.5 * (without.payload.scale or 0.0)
    assert found.trust.verdict == "good"
    assert any("on a scale" in note for note in found.notes)


def test_without_a_tare_it_is_the_robot_before_the_load() -> None:
    found = weigh(HYQ, loaded(), weight=(HYQ.mass, 0.05))
    assert len(found.changes) == 1
    assert found.mass == pytest.approx(TRUNK + LOAD, abs=0.01 * HYQ.mass)


def test_the_torques_scale_is_apart_from_the_rest_of_the_bar() -> None:
    result = tared()
    payload = result.payload
    assert payload is not None
    assert payload.mass_std_without_scale is not None
    total = np.hypot(payload.mass_std_without_scale, (payload.scale or 0.0) * payload.mass)
    assert payload.mass_std == pytest.approx(float(total), rel=1e-9)
    said = result.to_dict()["payload"]["mass"]
    assert said["std_without_scale"] == payload.mass_std_without_scale
    assert said["scale"] == payload.scale
    assert "% of it for the torques' scale" in repr(result)


def test_a_scale_that_contradicts_the_log_is_left_out_and_said() -> None:
    result, without = weigh(HYQ, loaded(), tare=(0.0, 2.8), weight=(1.3 * HYQ.mass, 0.05)), tared()
    assert result.trust.verdict == "doubtful"
    assert "the scale, which is left out, and the log are" in " ".join(result.trust.reasons)
    assert result.mass == pytest.approx(without.mass, rel=1e-3)
    assert result.payload is not None
    assert without.payload is not None
    assert result.payload.mass == pytest.approx(without.payload.mass, rel=1e-3)
    assert result.payload.mass_std == pytest.approx(without.payload.mass_std, rel=0.02)
    page = result.to_html()
    assert "widened" not in page
    assert "Write it into the model file" not in page
    assert "Write it into the model file" in without.to_html()


def test_bad_weights_are_named() -> None:
    assert parse.weight("15.2kg±0.05") == (15.2, 0.05)
    assert parse.weight("15.2 +- 0.1") == (15.2, 0.1)
    assert parse.weight("15")[1] == pytest.approx(0.058, abs=0.001)
    for text in ("heavy", "-3kg", "15±x", "nan"):
        with pytest.raises(typer.BadParameter, match="is not a weight like"):
            parse.weight(text)
    with pytest.raises(IdentificationError, match="on a scale"):
        weigh(HYQ, loaded(), weight=-3.0)
    with pytest.raises(IdentificationError, match=r"the legs of hyq alone have .* kg"):
        weigh(HYQ, loaded(), weight=2.0)
    with pytest.raises(IdentificationError, match=r"must be a number of kg, got '16.7kg'"):
        weigh(HYQ, loaded(), weight="16.7kg")  # type: ignore[arg-type]
    with pytest.raises(IdentificationError, match=r"must be a number of kg, got 'a'"):
        TrunkEstimator(HYQ).know_weight("a", 1.0)  # type: ignore[arg-type]
    with pytest.raises(IdentificationError, match=r"a range of time is a pair of numbers, \(0.0, 9.0\)"):
        weigh(HYQ, loaded(), tare="0:9")
    for tare in ((None, 3), (0, 1, 2), ("0", "3"), 3.0):
        with pytest.raises(IdentificationError, match=r"a pair of numbers \(begin, end\) \[s\], got"):
            weigh(HYQ, loaded(), tare=tare)  # type: ignore[arg-type]
    with pytest.raises(IdentificationError, match=r"memory takes a stadera.trunk.memory.Memory, .* got str"):
        weigh(HYQ, loaded(), memory="memory.json")  # type: ignore[arg-type]
    with pytest.raises(IdentificationError, match="kg are needed"):
        weigh(HYQ, loaded(), weight=1000.0 * HYQ.mass)
    with pytest.raises(IdentificationError, match="a weight is used, by 'walking' or 'standing'"):
        weigh(HYQ, loaded(), method="contact", weight=HYQ.mass)


def test_online_it_may_come_at_any_time() -> None:
    samples, early, late = Samples.of_recording(loaded(), HYQ), TrunkEstimator(HYQ), TrunkEstimator(HYQ)
    early.know_weight(HYQ.mass, 0.05)
    for estimator in (early, late):
        estimator.add(samples[samples.time < 2.8])
        estimator.tare()
        estimator.add(samples[samples.time >= 2.8])
    late.know_weight(HYQ.mass, 0.05)
    assert early.payload is not None
    assert late.payload is not None
    assert late.payload.mass == pytest.approx(early.payload.mass, rel=1e-4)
    assert late.trunk.mass_std == pytest.approx(early.trunk.mass_std, rel=0.02)


def test_a_scale_tells_the_trunk_of_a_robot_on_flat_feet() -> None:
    """Whose static friction, of which the rows tell two kinds together, changes with the load: the trunk's bar is that
    of the scale and of the links' masses.
    """
    robot = load_robot("g1")
    log = simulate(robot, "shake", SimulateSettings("real", duration=2.0, seed=7, hold=2)).recording
    estimator = TrunkEstimator(robot)
    estimator.add(Samples.of_recording(log, robot))
    links = np.linalg.norm([ModelErrors().link_mass * robot.inertias[link].mass for link in robot.tree.links[1:]])
    expected = pytest.approx(np.hypot(0.1, links), rel=0.1)
    assert estimator.bars_on_scale(0.1)[1] == expected
    estimator.know_weight(robot.mass, 0.1)
    assert estimator.trunk.mass_std == expected
