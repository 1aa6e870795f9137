"""Weighing while walking, fed with motion and forces that Pinocchio worked out."""

from __future__ import annotations

from collections.abc import Callable
from copy import deepcopy
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from stadera.constants import GRAVITY
from stadera.errors import ModelError, RecordingError, StaderaError
from stadera.inertia import InertialParameters
from stadera.lab.baselines import KalmanTrunk, LeastSquaresTrunk, RlsTrunk
from stadera.lab.plant.payload import RigidMass
from stadera.lab.plant.sensors import IDEAL, STANDARD, SensorErrors, estimator_model
from stadera.logs import Recording
from stadera.robot import JointDynamics, Robot, load_robot
from stadera.robot.imu import ImuMount
from stadera.trunk import (
    Measurement,
    ModelErrors,
    Samples,
    Status,
    SwingDetection,
    TrunkEstimator,
    TrunkModel,
    TrunkSettings,
    measurements_of,
)
from stadera.trunk.block_rows import BlockRows
from stadera.trunk.rows import RowMaker
from stadera.trunk.settings import ChangeSettings
from walking import Motion, Walk, recorded, walked

RATE = 500.0
TARED = 2.5  # s
STILL = Walk(seconds=3.0, rate_hz=RATE, speed=0.0, period=0.0, tilt=0.0, sway=0.0)


@cache
def robot(coulomb: float = 0.5) -> Robot:
    plain = load_robot("hyq")
    return plain.with_dynamics({joint: JointDynamics(0.02, 0.3, coulomb, 0.0) for joint in plain.tree.joints})


def trunk() -> InertialParameters:
    return robot().inertias[robot().trunk]


@cache
def load() -> InertialParameters:
    return RigidMass.box(0.08 * robot().mass, (0.2, 0.2, 0.1), (-0.2, 0.1, 0.2)).parameters


@cache
def motion(walk: Walk | None = None) -> Motion:
    return walked(robot(), walk or Walk(seconds=4.0, rate_hz=RATE, load=load(), loaded_at=TARED))


def recording(m: Motion, errors: SensorErrors = IDEAL, seed: int = 0) -> Recording:
    return recorded(robot(), m, errors, seed)


def samples(m: Motion, errors: SensorErrors = IDEAL, seed: int = 0) -> Samples:
    return Samples.of_recording(recording(m, errors, seed), robot())


def before(s: Samples, time: float) -> Samples:
    return s[: int(np.searchsorted(s.time, time))]


def after(s: Samples, time: float) -> Samples:
    return s[int(np.searchsorted(s.time, time)) :]


def error(estimator: TrunkEstimator, truth: InertialParameters) -> np.ndarray:
    return estimator.estimate().value - np.array([truth.mass, *truth.com])


@pytest.mark.parametrize("coulomb", [0.0, 0.5])
def test_finds_a_trunk_that_nothing_was_told_of(coulomb: float) -> None:
    """What sticks for a moment, and what it carries, is not known: with dry friction the mass is less sure."""
    start, made = TrunkModel(40.0, np.array([0.1, -0.05, 0.05])), robot(coulomb)
    estimator = TrunkEstimator(made, start=start)
    walk = walked(made, Walk(seconds=TARED, rate_hz=RATE))
    estimator.add(Samples.of_recording(recorded(made, walk, IDEAL, 0), made))
    found = estimator.trunk
    assert estimator.estimate().status is Status.CONVERGED
    assert found.observed.all()
    off, std = error(estimator, trunk()), np.sqrt(np.diag(estimator.estimate().covariance))
    assert (np.abs(off) < 3.0 * std).all()
    assert abs(off[0]) < 4e-4 * robot().mass  # with an unknown response of the IMU, 40 kg as a start count for more
    assert np.abs(off[1:]).max() < 4e-4
    np.testing.assert_allclose(found.inertial.vector[4:], trunk().vector[4:], atol=0.1)
    assert found.inertial.is_physical()


def test_wrong_legs_are_in_the_error_bars_and_cancel_in_the_payload() -> None:
    """Links 5 % and 5 mm off, over some draws: the trunk's normalised error is about one, the payload's bar small."""
    squared, count = 0.0, 0
    for seed in range(4):
        believed = estimator_model(robot(), replace(IDEAL, leg_mass=0.05, leg_com=0.005), seed)
        estimator = TrunkEstimator(believed)
        estimator.add(before(samples(motion()), TARED))
        found = estimator.trunk
        seen = found.observed[:4]
        off = error(estimator, trunk())[seen]
        squared += off @ np.linalg.solve(found.covariance[np.ix_(seen, seen)], off)
        count += int(seen.sum())
        estimator.tare()
        estimator.add(after(samples(motion()), TARED))
        put_on = estimator.payload
        assert put_on is not None
        assert put_on.mass_std < 0.35 * np.sqrt(found.covariance[0, 0])
        assert abs(put_on.mass - load().mass) < 3.0 * put_on.mass_std
    assert count >= 12
    assert 0.1 < squared / count < 1.6


def test_a_load_too_light_for_a_name_is_weighed_all_the_same() -> None:
    light = RigidMass.box(0.008 * robot().mass, (0.1, 0.1, 0.1), (-0.2, 0.1, 0.2)).parameters
    walk = walked(robot(), Walk(seconds=6.0, rate_hz=RATE, load=light, loaded_at=TARED))
    s, estimator = samples(walk, STANDARD, 1), TrunkEstimator(robot())
    estimator.add(before(s, TARED))
    estimator.tare()
    estimator.add(after(s, TARED))
    found = estimator.payload
    assert found is not None
    assert abs(found.mass - light.mass) < 3.0 * found.mass_std
    assert found.mass_std < 0.3 * light.mass
    assert estimator.changes == ()


def test_a_load_that_comes_with_the_tare_is_weighed_though_no_change_is_detected() -> None:
    blind = TrunkSettings(changes=ChangeSettings(deviations=1e3, agreeing=1e3))
    s, estimator = samples(motion(), STANDARD, 3), TrunkEstimator(robot(), settings=blind)
    estimator.add(before(s, TARED - 0.02))
    estimator.tare()
    estimator.add(before(after(s, TARED - 0.02), TARED + 0.7))
    assert abs(error(estimator, trunk() + load())[0]) < 0.01 * robot().mass, "not a mean of before and after"
    estimator.add(after(s, TARED + 0.7))
    payload = estimator.payload
    assert payload is not None
    assert estimator.changes == ()
    assert abs(payload.mass - load().mass) < min(0.01 * robot().mass, 3.0 * payload.mass_std)


def test_neither_slope_nor_heading_enters() -> None:
    estimator = TrunkEstimator(robot())
    estimator.add(samples(motion(Walk(seconds=1.5, rate_hz=RATE, slope=0.2))))
    assert np.abs(error(estimator, trunk())[1:]).max() < 1e-3


def test_weighs_a_payload_put_on_while_walking() -> None:
    s, estimator = samples(motion(), STANDARD, 3), TrunkEstimator(robot())
    estimator.add(before(s, TARED - 0.02))
    assert estimator.payload is None
    estimator.tare()
    estimator.add(after(s, TARED - 0.02))
    payload = estimator.payload
    assert payload is not None
    assert abs(payload.mass - load().mass) < 0.002 * robot().mass
    assert np.abs(payload.com - load().com)[:2].max() < 5e-3
    assert abs(payload.mass - load().mass) < 4.0 * payload.mass_std
    assert (np.abs(payload.com - load().com) < 4.0 * payload.com_std)[:2].all()
    absolute = estimator.estimate().std[0]
    assert payload.mass_std < absolute  # constant errors of both are alike
    (change,) = estimator.changes
    assert change.kind == "on"
    assert abs(change.time - TARED) < 0.1
    assert change.noticed - TARED < 0.3
    assert abs(change.mass - load().mass) < 4.0 * change.mass_std + 1e-3 * robot().mass


def test_notices_a_load_that_is_taken_off_and_one_that_is_shifted() -> None:
    loaded = Walk(seconds=4.0, rate_hz=RATE, load=load(), loaded_at=0.0)
    bare = replace(loaded, loaded_at=np.inf)
    moved = replace(loaded, load=load().shifted((0.25, 0.0, 0.0)))
    for second, kind in ((bare, "off"), (moved, "shifted")):
        efforts = motion(loaded).effort.copy()
        late = motion(loaded).time >= TARED
        efforts[late] = motion(second).effort[late]
        estimator = TrunkEstimator(robot())
        estimator.add(samples(replace(motion(loaded), effort=efforts), STANDARD, 5))
        (change,) = estimator.changes
        assert change.kind == kind
        assert change.noticed - TARED < 0.4


def test_bars_of_a_robot_without_model_errors_are_narrower_than_usual() -> None:
    """Its residuals show that most kinds of errors are small. The torques' common scale keeps its size."""
    squares, narrower = [], []
    for seed in range(4):
        estimator = TrunkEstimator(robot())
        estimator.add(before(samples(motion(), STANDARD, 100 + seed), TARED))
        assert not estimator.changes
        off, covariance = error(estimator, trunk()), estimator.estimate().covariance
        squares.append(off @ np.linalg.solve(covariance, off) / 4.0)
        usual = TrunkEstimator(robot(), settings=TrunkSettings(size_spread=1e-3))
        usual.add(before(samples(motion(), STANDARD, 100 + seed), TARED))
        narrower.append(estimator.estimate().std / usual.estimate().std)
    assert 0.0 < np.mean(squares) < 1.0
    assert (np.mean(narrower, axis=0)[1:] < 0.9).all(), narrower


def test_says_that_a_robot_standing_still_shows_neither_height_nor_inertia() -> None:
    estimator = TrunkEstimator(robot())
    estimator.add(samples(motion(STILL), STANDARD, 1))
    estimate, found = estimator.estimate(), estimator.trunk
    assert estimate.observed.tolist() == [True, True, True, False]
    assert not found.observed[4:].any()
    assert np.isnan(estimate.covariance[3]).all()
    assert estimate.trunk.com_trunk[2] == pytest.approx(trunk().com[2], abs=1e-15)  # of the model file
    assert (np.abs(error(estimator, trunk())[:3]) < 4.0 * estimate.std[:3]).all()


def test_a_stand_ten_times_as_long_neither_drifts_nor_is_surer_than_its_constants() -> None:
    """Noise in the rows' matrix would let what cannot be told apart, offsets and weight, wander ever more surely."""
    model = load_robot("go2")
    still = walked(model, replace(STILL, seconds=20.0, rate_hz=200.0))
    log = Samples.of_recording(recorded(model, still, STANDARD, 4), model)
    found = []
    for seconds in (2.0, 20.0):
        estimator = TrunkEstimator(model)
        estimator.add(before(log, seconds))
        found.append(estimator.estimate())
        assert abs(found[-1].value[0] - model.inertias[model.trunk].mass) < 2.0 * found[-1].std[0]
    short, long = found
    assert abs(long.value[0] - short.value[0]) < 0.003 * model.mass
    assert long.std[0] > 0.8 * short.std[0]


def test_a_small_sway_shows_the_height() -> None:
    estimator = TrunkEstimator(robot())
    estimator.add(before(samples(motion(replace(STILL, tilt=0.04, sway=0.01)), STANDARD, 1), 3.0))
    assert estimator.estimate().observed.all()
    assert abs(error(estimator, trunk())[3]) < 4.0 * estimator.estimate().std[3] < 0.06


def test_impacts_that_the_rate_does_not_resolve_do_not_make_the_trunk_lighter() -> None:
    """One sample of 15 to 30 g every fifth of a second, as an unfiltered accelerometer reads them at 200 Hz."""
    walk = walked(robot(), Walk(seconds=4.0, rate_hz=200.0))
    s = samples(walk, STANDARD, 1)
    struck = s.specific_force.copy()
    struck[40::40] += GRAVITY * np.random.default_rng(2).uniform(15.0, 30.0, (len(struck[40::40]), 3))
    estimator = TrunkEstimator(robot())
    estimator.add(replace(s, specific_force=struck))
    found = estimator.estimate()
    assert 0.2 < estimator.impacts < 1.2
    assert abs(found.value[0] - trunk().mass) < min(2.0 * found.std[0], 0.02 * robot().mass)
    assert not estimator.changes
    estimator = TrunkEstimator(robot(), settings=TrunkSettings(impact=1e9))
    estimator.add(replace(s, specific_force=struck))
    assert not estimator.impacts
    assert estimator.estimate().value[0] < trunk().mass - 0.03 * robot().mass  # what they would do


def delayed(late: int) -> TrunkEstimator:
    """An estimator whose torques are so many samples late."""
    m, estimator = motion(), TrunkEstimator(robot())
    effort = np.vstack([np.repeat(m.effort[:1], late, axis=0), m.effort[:-late]])
    estimator.add(before(samples(replace(m, effort=effort), STANDARD, 2), TARED))
    return estimator


def test_finds_by_how_much_torques_are_late() -> None:
    estimator, late = delayed(2), 2 / RATE
    std = estimator.errors.std[estimator.errors.layout.places["torque_lag"]].item()
    assert abs(estimator.torque_lag[0] - late) < 3.0 * std
    assert std < 1e-3


def test_the_bar_of_a_long_lag_contains_what_is_not_found_of_it() -> None:
    """Rows are linear in the lag: what they say of their own error is nothing of the rest."""
    estimator, late = delayed(12), 12 / RATE
    lag, std = estimator.torque_lag
    own = estimator.errors.std[estimator.errors.layout.places["torque_lag"]].item()
    assert 2.0 * own < late - lag < 2.0 * std
    assert std < 0.5 * late


def test_one_by_one_is_all_at_once() -> None:
    log = recording(motion(), STANDARD, 4)
    one, whole = TrunkEstimator(robot()), TrunkEstimator(robot())
    for measurement in measurements_of(log, robot()):
        one.update(measurement)
    whole.add(Samples.of_recording(log, robot()))
    np.testing.assert_allclose(one.estimate().value, whole.estimate().value, rtol=0, atol=1e-9)
    np.testing.assert_allclose(one.estimate().covariance, whole.estimate().covariance, rtol=1e-6)
    assert one.estimate().time == whole.estimate().time
    assert [c.time for c in one.changes] == [c.time for c in whole.changes]


def test_goes_on_over_what_is_missing_and_names_it() -> None:
    s = before(samples(motion(), STANDARD, 6), TARED)
    effort, time = s.effort.copy(), s.time.copy()
    effort[100:107, 4] = np.nan
    time[300] = time[299]
    holed = Samples(time, s.position, s.velocity, effort, s.angular_velocity, s.specific_force)
    keep = np.ones(len(s), dtype=bool)
    keep[400:450] = False
    estimator = TrunkEstimator(robot())
    estimator.add(holed[keep])
    assert (np.abs(error(estimator, trunk())) < 4.0 * estimator.estimate().std).all()
    assert not estimator.changes
    last = estimator.estimate()
    estimator.add(holed[100:101])
    refused = estimator.estimate()
    assert refused.status is Status.REFUSED
    assert "not finite: effort of joint" in refused.reason
    np.testing.assert_array_equal(last.value, refused.value)
    estimator.add(s[0:1])
    assert "time must increase" in estimator.estimate().reason


def test_samples_that_were_not_learnt_from_are_not_joined_to_those_after_a_restart() -> None:
    s = samples(motion(), STANDARD, 6)
    left, whole = TrunkEstimator(robot()), TrunkEstimator(robot())
    left.learning(before(s, 1.0).table)
    left.restart()
    for estimator in (left, whole):
        estimator.add(after(s, 1.5))
    np.testing.assert_array_equal(left.estimate().value, whole.estimate().value)


def test_after_forgetting_rows_are_those_of_a_maker_that_saw_nothing_before() -> None:
    """Gravity is elsewhere in a trunk that was turned where nobody saw it."""
    level, tilted = (samples(motion(replace(STILL, slope=slope)), STANDARD, 1) for slope in (0.0, 0.2))
    known, new = (RowMaker(robot(), ImuMount.of(robot()), SwingDetection()) for _ in range(2))

    def made(maker: RowMaker, log: Samples, blocks: int) -> list[BlockRows | None]:
        log = log[: 10 * blocks + 2]
        up = np.tile([0.0, 0.0, 1.0], (10 * blocks, 1))
        return maker.blocks(log, (10,) * blocks, maker.motion(log)._replace(normal=up), trunk())[0]

    made(known, level, 50)
    known.forget()
    new.noise = deepcopy(known.noise)
    for k, (one, other) in enumerate(zip(made(known, tilted, 10), made(new, tilted, 10), strict=True)):
        assert (one is None) == (other is None) == (k == 0)
        if one is not None and other is not None:
            np.testing.assert_array_equal(one.matrix, other.matrix)


def test_an_accelerometer_that_reads_zero_is_named_and_got_over() -> None:
    """As drivers do that have not started yet."""
    s = before(samples(motion(), STANDARD, 6), TARED)
    force = s.specific_force.copy()
    force[:100] = 0.0
    estimator = TrunkEstimator(robot())
    estimator.add(replace(s, specific_force=force)[:100])
    assert estimator.estimate().status is Status.REFUSED
    assert "accelerometer reads zero" in estimator.estimate().reason
    estimator.add(s[100:])
    assert estimator.estimate().status is Status.CONVERGED
    assert (np.abs(error(estimator, trunk())) < 4.0 * estimator.estimate().std).all()


def test_a_leg_that_is_stretched_is_named() -> None:
    s = before(samples(motion(), IDEAL), 0.2)
    estimator = TrunkEstimator(robot())
    estimator.add(replace(s, position=np.zeros_like(s.position)))
    assert estimator.estimate().status is Status.REFUSED
    assert "stretched" in estimator.estimate().reason


def test_torques_of_the_wrong_sign_never_make_a_trunk() -> None:
    s = before(samples(motion(), STANDARD), TARED)
    estimator = TrunkEstimator(robot())
    estimator.add(replace(s, effort=-s.effort))
    assert estimator.estimate().status is Status.REFUSED
    assert "runs away" in estimator.estimate().reason
    assert not estimator.estimate().observed.any()
    assert estimator.trust.verdict == "bad"
    assert "runs away" in estimator.trust.reasons[0]


@pytest.mark.parametrize("method", [LeastSquaresTrunk, RlsTrunk, KalmanTrunk])
def test_baselines_come_near(method: type[LeastSquaresTrunk] | type[RlsTrunk] | type[KalmanTrunk]) -> None:
    estimator = method(robot())
    for measurement in measurements_of(recording(motion()), robot()):
        estimator.update(measurement)
    off = estimator.estimate().value - np.array([(trunk() + load()).mass, *(trunk() + load()).com])
    assert abs(off[0]) < 0.05 * robot().mass
    assert np.abs(off[1:3]).max() < 0.03
    assert estimator.estimate().observed[3] == (method is not KalmanTrunk)


def test_joints_in_another_order_are_all_there_once() -> None:
    robot = load_robot("hyq")
    joints = robot.tree.joints
    with pytest.raises(StaderaError, match=f"have joint '{joints[0]}' twice"):
        TrunkEstimator(robot, joints=(*joints, joints[0]))
    with pytest.raises(StaderaError, match=f"lack joint '{joints[-1]}'; joints that hyq has not are knee"):
        TrunkEstimator(robot, joints=(*joints[:-1], "knee"))
    with pytest.raises(StaderaError, match=f"lack joint '{joints[-1]}'$"):
        TrunkEstimator(robot, joints=joints[:-1])


def test_bad_settings_are_named() -> None:
    with pytest.raises(ModelError, match="gain"):
        ModelErrors(gain=-0.1)
    with pytest.raises(ModelError, match="alike"):
        ModelErrors(alike=1.0)
    with pytest.raises(StaderaError, match="block"):
        TrunkSettings(block=0.001)
    s = before(samples(motion()), 0.1)
    with pytest.raises(RecordingError, match="effort"):
        Samples(s.time, s.position, s.velocity, s.effort[:-1], s.angular_velocity, s.specific_force)
    with pytest.raises(RecordingError, match="no IMU"):
        Samples.of_recording(replace(recording(motion()), imu=None), robot())


@pytest.mark.parametrize(
    ("settings", "name"),
    [
        (lambda: ChangeSettings(deviations=-1.0), "deviations"),
        (lambda: ChangeSettings(trusted=float("nan")), "trusted"),
        (lambda: ChangeSettings(windows=(12, 6)), "windows"),
        (lambda: ChangeSettings(windows=()), "windows"),
        (lambda: ChangeSettings(windows=(6, 200)), "pending"),
        (lambda: ChangeSettings(agreeing=6.0), "agreeing"),
        (lambda: SwingDetection(repeated=0.5), "repeated"),
        (lambda: SwingDetection(lift=0.0), "lift"),
    ],
)
def test_bad_settings_of_detection_are_named(settings: Callable[[], object], name: str) -> None:
    with pytest.raises(StaderaError, match=name):
        settings()


def test_measurements_make_the_same_samples() -> None:
    log = recording(motion(), STANDARD, 4)
    made: list[Measurement] = list(measurements_of(log, robot()))[:7]
    direct = Samples.of_recording(log, robot())[:7]
    for name in ("time", "position", "velocity", "effort", "angular_velocity", "specific_force"):
        np.testing.assert_allclose(getattr(Samples.of(made), name), getattr(direct, name), atol=1e-12)


def test_known_offsets_are_taken_out_with_their_sign() -> None:
    """A constant added to the torques and the same offset in the model leave the trunk as it is; with the other sign
    the error is twice that of a model without it.
    """
    plain = robot()
    limit = np.array([plain.limits[joint].effort for joint in plain.tree.joints])
    added = 0.01 * limit * np.random.default_rng(3).choice([-1.0, 1.0], 12)
    log = recorded(plain, walked(plain, replace(STILL, seconds=2.0, tilt=0.05, sway=0.012)), IDEAL)

    def weighed(offset: float, error: float) -> np.ndarray:
        """Mass and first moment, with a multiple of the offsets in the model, and of the error in the log."""
        known = plain.with_dynamics(
            {
                joint: replace(plain.dynamics[joint], offset=offset * float(value))
                for joint, value in zip(plain.tree.joints, added, strict=True)
            }
        )
        samples = Samples.of_recording(log, known)
        estimator = TrunkEstimator(known)
        estimator.add(replace(samples, effort=samples.effort + error * added))
        return np.asarray(estimator.trunk.inertial.vector[:4])

    true = weighed(0.0, 0.0)
    right, ignored, wrong = (weighed(offset, 1.0) - true for offset in (1.0, 0.0, -1.0))
    assert np.abs(ignored[1:]).max() > 0.02 * plain.mass * 0.1
    np.testing.assert_allclose(right, 0.0, atol=1e-3 * np.abs(ignored).max())
    np.testing.assert_allclose(wrong, 2.0 * ignored, atol=0.2 * np.abs(ignored).max())


def pushed(share: float, begin: float, end: float) -> Samples:
    """A trot without errors of the model, pushed upwards: every leg's torques are smaller by the same share."""
    walk = motion(Walk(seconds=8.0, rate_hz=RATE))
    made = samples(walk, STANDARD, 3)
    during = (made.time >= begin) & (made.time < end)
    return replace(made, effort=np.where(during[:, None], (1.0 - share) * made.effort, made.effort))


@pytest.mark.parametrize(("share", "seconds"), [(0.4, 0.2), (0.2, 0.5), (-0.3, 1.0)])
def test_a_push_is_withdrawn_and_what_was_known_before_is_kept(share: float, seconds: float) -> None:
    estimator, made = TrunkEstimator(robot()), pushed(share, 4.0, 4.0 + seconds)
    estimator.add(before(made, 4.0))
    known, std = estimator.estimate().value[0], estimator.estimate().std[0]
    estimator.add(before(after(made, 4.0), 4.0 + seconds + 0.5))
    assert not estimator.changes
    assert abs(estimator.estimate().value[0] - known) < 0.5 * std
    estimator.add(after(made, 4.0 + seconds + 0.5))
    assert not estimator.changes
    assert abs(estimator.estimate().value[0] - known) < 0.5 * std


def test_a_push_is_said_while_it_lasts() -> None:
    estimator = TrunkEstimator(robot())
    estimator.add(before(pushed(0.4, 4.0, 5.0), 4.9))
    (change,) = estimator.changes
    assert change.mass == pytest.approx(-0.4 * robot().mass, rel=0.3)


def test_white_noise_does_not_make_the_trunk_lighter_the_longer_the_log() -> None:
    """Torques' noise is in the target and in the columns of the model's errors: p̂ would follow it ever more."""
    walk, noisy = motion(Walk(seconds=24.0, rate_hz=RATE)), []
    estimator, begin = TrunkEstimator(robot()), 0.0
    loud = replace(STANDARD, torque=3.0 * STANDARD.torque, torque_constant=0.0, accelerometer_constant=0.0)
    made = samples(walk, replace(loud, accelerometer=3.0 * STANDARD.accelerometer, gyro_constant=0.0), 3)
    for end in (4.0, 24.0):
        estimator.add(made[(made.time >= begin) & (made.time < end)])
        begin = end
        noisy.append(error(estimator, trunk())[0] / robot().mass)
    assert abs(noisy[1]) < max(abs(noisy[0]), 0.003)
