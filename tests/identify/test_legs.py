"""Legs from a log, end to end: what is recovered, what is said of it, and what bad input gets."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from identify.leg_runs import DRIVE, SMOOTH, cut, exact_run, hyq, noisy, other_hyq, parameters_of, run, swing
from stadera.body import FrictionModel, JointMotion, JointTorqueRegressor, TrunkMotion
from stadera.errors import (
    IdentificationError,
    MissingExtraError,
    RecordingError,
    StaderaError,
    UnknownNameError,
    UntrustedError,
)
from stadera.identify import log as log_module
from stadera.identify.job import parts_of, prepare
from stadera.identify.legs import identify
from stadera.identify.observability import Identifiability
from stadera.identify.result import Identification
from stadera.identify.settings import IdentifySettings
from stadera.logs import Imu, Recording, concatenate, write_table
from stadera.robot import JointLimits, load_robot

RH = IdentifySettings(legs=("RH",))
EXACT = replace(RH, cutoff_hz=None, torque_lag=0.0)


def truth_of(columns: tuple[str, ...], drive=DRIVE) -> dict[str, float]:
    robot = other_hyq()
    return parameters_of(robot.with_dynamics(dict.fromkeys(robot.tree.joints, drive)), columns)


def check_finite(result: Identification) -> None:
    """No number of a result is NaN or infinite."""
    for leg in result.legs:
        assert np.isfinite(leg.estimate.values).all()
        assert np.isfinite(leg.estimate.covariance).all()
        for quantity in (*leg.parameters.values(), *(q for com in leg.coms.values() for q in com)):
            assert np.isfinite([quantity.prior, quantity.value]).all()
            assert quantity.std is None or (np.isfinite(quantity.std) and quantity.std >= 0)
        for known in leg.combinations:
            assert np.isfinite([known.prior, known.value]).all()
            assert known.std is None or np.isfinite(known.std)
        for by_model in leg.rmse.values():
            assert all(np.isfinite(v) for by_joint in by_model.values() for v in by_joint.values())
        for trace in leg.traces:
            assert np.isfinite(trace.measured).all()
            assert all(np.isfinite(v).all() for v in trace.predicted.values())


def values(result: Identification) -> dict[str, float]:
    return {k: v for leg in result.legs for k, v in leg.estimate.by_name().items()}


def assert_same(first: Identification, second: Identification, share: float = 1e-6) -> None:
    """The same values to a share of the prior's widths."""
    for a, b in zip(first.legs, second.legs, strict=True):
        gap = (a.estimate.values - b.estimate.values) / a.estimate.prior.scales
        np.testing.assert_allclose(gap, 0.0, atol=share)
        assert a.estimate.observability.rank == b.estimate.observability.rank
        for part, models in a.rmse.items():
            for model, joints in models.items():
                assert b.rmse[part][model] == pytest.approx(joints, rel=1e-4, abs=1e-9)


# -- recovery -----------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("method", ["consistent", "null-space"])
def test_exact_signals_give_the_leg_exactly(method: str) -> None:
    result = identify(hyq(), [exact_run()], replace(EXACT, method=method))
    check_finite(result)
    (leg,) = result.legs
    assert leg.structural_rank == 27 + 9  # links and drives, and how three joints' friction varies
    assert len(leg.combinations) == 27
    truth = truth_of(leg.estimate.columns, SMOOTH)
    for name, quantity in leg.parameters.items():
        width = leg.estimate.prior.scales[leg.estimate.columns.index(name)]
        if quantity.verdict is Identifiability.OBSERVABLE:
            assert quantity.value == pytest.approx(truth[name], abs=1e-5 * width), name
        if quantity.verdict is Identifiability.UNOBSERVABLE:
            assert quantity.std is None
        if name.endswith(".m"):
            assert quantity.verdict is not Identifiability.OBSERVABLE
            assert quantity.value == pytest.approx(quantity.prior)
    scale = leg.rmse["validation"]["prior"]
    assert all(v < 1e-4 * scale[j] for j, v in leg.rmse["validation"]["identified"].items())
    assert result.is_physical or method == "null-space"
    assert result.validated_on == "the last 50 % of the log"


def test_filtered_signals_with_friction_and_noise() -> None:
    """Positions and efforts alone, with encoder and torque noise: better than CAD with friction, noise explained."""
    recording = noisy(run(DRIVE), effort=0.2, position=2e-5)
    result = identify(hyq(), [recording], replace(RH, torque_lag=0.0))
    check_finite(result)
    (leg,) = result.legs
    assert result.is_physical
    errors = leg.rmse["validation"]
    for joint in leg.leg.joints:  # the joints stick now and then, which no model here explains
        assert errors["identified"][joint] < 1.01 * errors["prior_friction"][joint] < 0.2 * errors["prior"][joint]
    total = {m: np.linalg.norm(list(errors[m].values())) for m in errors}
    assert total["identified"] < 0.97 * total["prior_friction"]
    truth = truth_of(leg.estimate.columns)
    for joint in leg.leg.joints:
        for term, tolerance in {"viscous": 0.05, "coulomb": 0.06}.items():
            name = f"{joint}.{term}"
            assert leg.parameters[name].value == pytest.approx(truth[name], abs=tolerance), name


def test_known_parameters_lie_within_their_spread() -> None:
    """White torque noise on exact signals: errors within what they are claimed to be."""
    recording = noisy(exact_run(), effort=0.5)
    (leg,) = identify(hyq(), [recording], replace(EXACT, split=1.0)).legs
    truth = truth_of(leg.estimate.columns, SMOOTH)
    errors = []
    for name, quantity in leg.parameters.items():
        if quantity.verdict is Identifiability.OBSERVABLE:
            errors.append((quantity.value - truth[name]) / quantity.std)
    assert len(errors) >= 5
    assert np.abs(errors).max() < 5.0
    assert np.sqrt(np.mean(np.square(errors))) < 2.5
    assert leg.noise == pytest.approx(dict.fromkeys(leg.leg.joints, 0.5), rel=0.1)


def test_identified_robot_moves_as_the_log_did() -> None:
    result = identify(hyq(), [exact_run()], EXACT)
    robot = result.identified_robot()
    assert robot.inertias[robot.trunk] == hyq().inertias[robot.trunk]
    assert robot.inertias["lf_upperleg"] == hyq().inertias["lf_upperleg"]
    regressor = JointTorqueRegressor(robot.leg_tree("RH"), FrictionModel.full())
    recording = exact_run(seed=4)
    motion = JointMotion(recording.position, recording.velocity, recording.acceleration)
    torque = regressor.predict(motion, parameters_of(robot, regressor.columns))
    np.testing.assert_allclose(torque, recording.effort, atol=2e-3 * np.abs(recording.effort).max())


def test_torque_lag_is_found_and_told() -> None:
    recording = run(DRIVE)
    late = replace(recording, effort=CubicSpline(recording.time, recording.effort)(recording.time + 0.01))
    result = identify(hyq(), [late], RH)
    assert result.torque_lag == pytest.approx(0.01, abs=5e-4)
    assert any("torque lag estimated at" in note for note in result.notes)
    assert identify(hyq(), [recording], RH).torque_lag == 0.0


def test_tilted_trunk() -> None:
    """A trunk on its side: the same leg, given the vertical or an IMU; a wrong vertical fits worse."""
    up = np.array([0.3, 0.5, 0.8])
    robot, recording = other_hyq(), exact_run()
    regressor = JointTorqueRegressor(robot.leg_tree("RH"))
    motion = JointMotion(recording.position, recording.velocity, recording.acceleration)
    torque = regressor.predict(motion, parameters_of(robot, regressor.columns), TrunkMotion.held(up))
    tilted = replace(recording, effort=torque)
    given = identify(hyq(), [tilted], replace(EXACT, up=tuple(up)))
    wrong = identify(hyq(), [tilted], EXACT)
    n = len(recording)
    imu = Imu(np.zeros((n, 3)), np.tile(9.81 * up / np.linalg.norm(up), (n, 1)), frame=None)
    sensed = identify(replace(hyq(), frames={}), [replace(tilted, imu=imu)], EXACT)
    assert_same(given, sensed, 1e-4)
    assert any("vertical from the IMU" in note for note in sensed.notes)
    for joint in given.legs[0].leg.joints:
        assert given.legs[0].rmse["validation"]["identified"][joint] < 1e-3 * max(np.abs(torque).max(), 1.0)
    assert max(wrong.legs[0].rmse["validation"]["identified"].values()) > 0.05
    turning = replace(tilted, imu=replace(imu, angular_velocity=np.full((n, 3), 0.5)))
    assert any("turning" in w for w in identify(replace(hyq(), frames={}), [turning], EXACT).warnings)


# -- logs in parts ------------------------------------------------------------------------------------------------
def test_a_file_is_the_recording(tmp_path: Path) -> None:
    recording = run(DRIVE)
    path = write_table(recording, tmp_path / "log.parquet")
    settings = replace(RH, torque_lag=0.0)
    assert_same(identify(hyq(), [recording], settings), identify(hyq(), [path], settings))


def test_a_file_read_again_at_each_pass_is_the_file_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = write_table(run(DRIVE), tmp_path / "log.parquet")
    settings = replace(RH, torque_lag=0.0)
    kept = identify(hyq(), [path], settings)
    monkeypatch.setattr(log_module, "KEEP_SAMPLES", 100)
    again = identify(hyq(), [path], settings)
    job = prepare(hyq(), [path], settings, lambda *_: None)
    training, _, _ = parts_of(job, [path], None)
    first, second = (sum(map(len, training)) for _ in range(2))
    assert first == second > 100
    assert_same(kept, again, 1e-12)


def test_two_logs_are_merged() -> None:
    """Each alone knows less; together they know the leg as well as the log that holds both."""
    settings = replace(EXACT, split=1.0)
    first, second = exact_run(seed=1), exact_run(seed=2)
    later = replace(second, time=second.time + first.time[-1] + 100.0, source=first.source)
    assert_same(
        identify(hyq(), [first, second], settings), identify(hyq(), [concatenate([first, later])], settings), 1e-4
    )
    assert identify(hyq(), [first, second], settings).source == "exact1, exact2"


def test_a_log_in_place_of_the_settings_is_refused() -> None:
    with pytest.raises(IdentificationError, match=r"got Recording of 'exact4'.*; several logs go in a list: \[a, b\]"):
        identify(hyq(), exact_run(), exact_run(seed=4))  # type: ignore[arg-type]


def test_the_same_samples_twice_are_refused() -> None:
    """Also with other stamps, in single precision."""
    one = exact_run()
    again = replace(one, time=one.time + 50.0, effort=one.effort.astype(np.float32).astype(float), source="copy")
    with pytest.raises(RecordingError, match="copy: holds the same samples as exact0; give each log once"):
        identify(hyq(), [one, exact_run(seed=4), again], EXACT)


def test_validation_on_another_log() -> None:
    result = identify(hyq(), [exact_run()], EXACT, validation=[exact_run(seed=4)])
    assert result.validated_on == "exact4"
    (leg,) = result.legs
    whole = identify(hyq(), [exact_run()], replace(EXACT, split=1.0)).legs[0]
    np.testing.assert_allclose(leg.estimate.values, whole.estimate.values, rtol=1e-9)  # nothing is kept back
    assert set(whole.rmse) == {"training"}
    identified, friction = (leg.rmse["validation"][m] for m in ("identified", "prior_friction"))
    assert all(identified[j] < 0.1 * friction[j] for j in leg.leg.joints)


def test_the_held_out_half_is_not_trained_on() -> None:
    recording = exact_run()
    n = len(recording) // 2
    spoilt = recording.effort.copy()
    spoilt[n + 1 :] += 50.0
    there, again = (identify(hyq(), [r], EXACT).legs[0] for r in (recording, replace(recording, effort=spoilt)))
    np.testing.assert_array_equal(there.estimate.values, again.estimate.values)
    assert min(again.rmse["validation"]["identified"].values()) > 40.0


def test_rmse_is_a_root_mean_square_of_the_residual() -> None:
    recording = exact_run()
    result = identify(hyq(), [recording], replace(EXACT, split=1.0))
    (leg,) = result.legs
    regressor = JointTorqueRegressor(hyq().leg_tree("RH"), FrictionModel.full())
    moving = (np.abs(recording.velocity) >= 0.01).any(axis=1)
    motion = JointMotion(recording.position[moving], recording.velocity[moving], recording.acceleration[moving])
    guess = regressor.predict(motion, parameters_of(hyq(), regressor.columns))
    expected = np.sqrt(np.mean((recording.effort[moving] - guess) ** 2, axis=0))
    np.testing.assert_allclose(list(leg.rmse["training"]["prior"].values()), expected, rtol=1e-2)


def test_all_four_legs_lean_on_each_other() -> None:
    """The RH leg's run on all legs: drives pooled, the same leg found four times over; alone where asked for.

    Forced, because the front knees of HyQ bend the other way and so are beyond their limits.
    """
    recording = run(DRIVE)
    names = hyq().tree.joints
    four = Recording(
        recording.time, names, np.tile(recording.position, 4), effort=np.tile(recording.effort, 4), source="four"
    )
    settings = IdentifySettings(torque_lag=0.0)
    pooled, alone = (identify(hyq(), [four], s, force=True) for s in (settings, replace(settings, spread=None)))
    assert [leg.leg.name for leg in pooled.legs] == ["LF", "RF", "LH", "RH"]
    assert any("alike" in note for note in pooled.notes)
    assert not any("alike" in note for note in alone.notes)
    single = identify(hyq(), [recording], replace(settings, legs=("rh", "RH"), spread=None))
    assert len(single.legs) == 1
    np.testing.assert_allclose(
        alone.legs[3].estimate.values,
        single.legs[0].estimate.values,
        atol=1e-6 * single.legs[0].estimate.prior.scales.max(),
    )
    check_finite(pooled)


# -- what a log does not tell -------------------------------------------------------------------------------------
def at_rest(seconds: float = 10.0) -> Recording:
    time = np.arange(0.0, seconds, 0.004)
    n = len(time)
    return Recording(
        time, hyq().leg("RH").joints, np.tile([0.0, -0.6, 1.2], (n, 1)), effort=np.tile([1.0, 2.0, 3.0], (n, 1))
    )


def test_motors_that_are_off_are_refused() -> None:
    """Unless forced."""
    off = replace(at_rest(), effort=0.01 * at_rest().effort)
    with pytest.raises(UntrustedError, match=r"no joint moves, and the motors seem to be off: .* up to 0.03"):
        identify(hyq(), off, RH)
    identify(hyq(), off, RH, force=True)


@pytest.mark.parametrize("method", ["consistent", "null-space"])
def test_a_log_at_rest(method: str) -> None:
    result = identify(hyq(), [at_rest()], replace(RH, method=method))
    check_finite(result)
    assert any("no sample moves" in w for w in result.warnings)
    assert result.rank <= 3  # three constant torques
    assert any("poor excitation" in w for leg in result.legs for w in leg.warnings)


def test_a_log_whose_second_half_rests() -> None:
    """Nothing is validated on samples that are not there, and no zero is passed off as an error."""
    moving = exact_run()
    n = len(moving)
    still = replace(
        moving,
        time=moving.time + moving.time[-1] + 0.004,
        position=np.tile(moving.position[-1], (n, 1)),
        velocity=np.zeros((n, 3)),
        acceleration=np.zeros((n, 3)),
        effort=np.tile(moving.effort[-1], (n, 1)),
    )
    result = identify(hyq(), [concatenate([moving, still])], EXACT)
    check_finite(result)
    (leg,) = result.legs
    assert "validation" not in leg.rmse
    assert result.validated_on is None
    assert any("does not move in the validation part" in w for w in leg.warnings)
    first_rests = identify(hyq(), [still, replace(moving, time=moving.time + 100.0)], replace(EXACT, split=1.0))
    check_finite(first_rests)
    for name, value in values(identify(hyq(), [moving], replace(EXACT, split=1.0))).items():
        assert values(first_rests)[name] == pytest.approx(value, rel=1e-4, abs=1e-6)


def test_poor_excitation_is_told() -> None:
    """One joint swings alone: a lower rank, a warning that says so, and the rest as the model has it."""
    reference = swing(10.0, scale=0.5)
    motion = reference.sample(250.0)
    only = np.array([0.0, 0.0, 1.0])
    position = motion.position * only + reference.rest * (1 - only)
    joints = JointMotion(position, motion.velocity * only, motion.acceleration * only)
    regressor = JointTorqueRegressor(other_hyq().leg_tree("RH"))
    torque = regressor.predict(joints, parameters_of(other_hyq(), regressor.columns))
    recording = Recording(
        reference.sample(250.0).time,
        regressor.tree.joints,
        joints.position,
        joints.velocity,
        joints.acceleration,
        torque,
    )
    result = identify(hyq(), [noisy(recording, 0.05)], EXACT)
    (leg,) = result.legs
    assert leg.estimate.observability.rank < leg.structural_rank
    assert any(w.startswith(f"poor excitation: the data determine {result.rank} of") for w in leg.warnings)
    haa = f"{leg.leg.joints[0]}.viscous"
    assert leg.parameters[haa].verdict is Identifiability.UNOBSERVABLE
    assert leg.parameters[haa].std is None
    check_finite(result)


def test_saturated_torques_are_told() -> None:
    recording = exact_run()
    limit = 0.9 * float(np.abs(recording.effort[:, 2]).max())
    limits = dict(hyq().limits) | {hyq().leg("RH").joints[2]: JointLimits(effort=limit)}
    clipped = replace(recording, effort=np.clip(recording.effort, [-np.inf, -np.inf, -limit], [np.inf, np.inf, limit]))
    (leg,) = identify(replace(hyq(), limits=limits), [clipped], EXACT).legs
    assert any(w.startswith(leg.leg.joints[2]) and "torque limit" in w for w in leg.warnings)
    (free,) = identify(hyq(), [recording], EXACT).legs
    assert not any("torque limit" in w for w in free.warnings)


def test_outliers_are_told() -> None:
    recording = noisy(exact_run(), 0.1)
    effort = recording.effort.copy()
    effort[100:-1:97, 1] += 20.0
    (leg,) = identify(hyq(), [replace(recording, effort=effort)], EXACT).legs
    assert any(leg.leg.joints[1] in w and "6 times the RMSE" in w for w in leg.warnings)


def test_a_torque_that_never_changes_is_told() -> None:
    recording = exact_run()
    effort = recording.effort.copy()
    effort[:, 2] = 1.5
    (leg,) = identify(hyq(), [replace(recording, effort=effort)], EXACT).legs
    assert any(w.startswith(leg.leg.joints[2]) and "never changes" in w for w in leg.warnings)


def test_negative_rotor_inertia_is_told() -> None:
    """A drive that pushes along with the acceleration: the free solution says so, the consistent one forbids it."""
    recording = exact_run()
    joint = hyq().leg("RH").joints[1]
    helped = recording.effort.copy()
    helped[:, 1] -= 0.3 * recording.acceleration[:, 1]
    told = replace(recording, effort=helped)
    results = {m: identify(hyq(), [told], replace(EXACT, method=m)) for m in ("consistent", "null-space")}
    assert results["consistent"].is_physical
    for result in results.values():
        assert any(w.startswith(joint) and "rotor inertia" in w and "negative" in w for w in result.legs[0].warnings)
    if not results["null-space"].is_physical:
        assert any("not physically consistent" in reason for reason in results["null-space"].trust.reasons)


def test_a_short_log_is_told() -> None:
    result = identify(hyq(), [cut(exact_run(), 1000, 1150)], replace(EXACT, split=1.0))
    check_finite(result)
    assert any("moving samples" in w for w in result.warnings)


# -- settings and bad input ---------------------------------------------------------------------------------------
def test_terms_not_asked_for_stay_at_the_model() -> None:
    """Viscous friction known and kept: its column is taken to the right-hand side (eq. 6)."""
    model = hyq().with_dynamics(dict.fromkeys(hyq().tree.joints, SMOOTH))
    result = identify(model, [exact_run()], replace(EXACT, friction=FrictionModel(("armature",))))
    (leg,) = result.legs
    assert len(leg.estimate.columns) == 33
    assert not any(c.endswith((".viscous", ".offset", ".coulomb")) for c in leg.estimate.columns)
    scale = leg.rmse["validation"]["prior"]
    assert all(v < 1e-4 * scale[j] for j, v in leg.rmse["validation"]["identified"].items())
    robot = result.identified_robot()
    assert robot.dynamics[leg.leg.joints[0]].viscous == SMOOTH.viscous


def test_progress_is_told() -> None:
    steps: list[tuple[str, int, int]] = []
    identify(hyq(), [exact_run()], RH, progress=lambda *step: steps.append(step))
    assert {"summing up the torques", "solving", "scoring", "validating"} <= {name for name, _, _ in steps}


def test_settings_refuse() -> None:
    with pytest.raises(UnknownNameError, match="'magic'; valid: consistent, null-space"):
        IdentifySettings(method="magic")
    for split in (0.0, -0.5, 1.5, np.nan):
        with pytest.raises(IdentificationError, match="split"):
            IdentifySettings(split=split)
    for up in ((0.0, 0.0, 0.0), (1.0, np.nan, 0.0), (1.0, 0.0)):
        with pytest.raises(IdentificationError, match="vertical"):
            IdentifySettings(up=up)


def test_no_logs() -> None:
    with pytest.raises(RecordingError, match="no log given"):
        identify(hyq(), [])


def test_a_leg_that_is_none() -> None:
    with pytest.raises(UnknownNameError, match="unknown leg 'XX'; valid: LF, RF, LH, RH"):
        identify(hyq(), [exact_run()], replace(RH, legs=("XX",)))


def test_a_leg_that_is_not_recorded() -> None:
    with pytest.raises(StaderaError, match="lf_haa_joint"):
        identify(hyq(), [exact_run()], replace(RH, legs=("LF",)))


def test_no_torques() -> None:
    with pytest.raises(RecordingError, match=r"rh_haa_joint\.effort"):
        identify(hyq(), [replace(run(DRIVE), effort=None)], RH)


@pytest.mark.parametrize("samples", [1, 2, 5, 40])
def test_too_few_samples(samples: int) -> None:
    with pytest.raises(StaderaError, match="too few samples"):
        identify(hyq(), [cut(run(DRIVE), 500, 500 + samples)], RH)


@pytest.mark.parametrize("cutoff", [-1.0, np.nan, 1e6])
def test_a_cutoff_that_is_none(cutoff: float) -> None:
    with pytest.raises(StaderaError, match="cut-off"):
        identify(hyq(), [run(DRIVE)], replace(RH, cutoff_hz=cutoff))


def test_a_lag_that_is_none() -> None:
    with pytest.raises(StaderaError, match="effort_delay"):
        identify(hyq(), [run(DRIVE)], replace(RH, torque_lag=3.0))


# -- what is said of it -------------------------------------------------------------------------------------------
def test_clean_data_raise_no_alarm() -> None:
    (leg,) = identify(hyq(), [exact_run()], EXACT).legs
    assert leg.warnings == ()


def test_a_leg_that_rests_while_another_moves() -> None:
    recording = exact_run()
    names = (*hyq().leg("RH").joints, *hyq().leg("LF").joints)
    n = len(recording)
    still = (np.tile([0.0, 0.6, -1.2], (n, 1)), np.zeros((n, 3)), np.zeros((n, 3)), np.tile([1.0, 2.0, 3.0], (n, 1)))
    moving = (recording.position, recording.velocity, recording.acceleration, recording.effort)
    both = Recording(recording.time, names, *(np.hstack(pair) for pair in zip(moving, still, strict=True)))
    result = identify(hyq(), [both], replace(EXACT, legs=("RH", "LF"), spread=None))
    check_finite(result)
    assert set(result.legs[0].rmse) == {"training", "validation"}
    assert result.legs[1].rmse == {}
    assert any("does not move in the training part" in w for w in result.legs[1].warnings)
    assert result.legs[1].estimate.is_physical


# -- real logs ----------------------------------------------------------------------------------------------------
@pytest.fixture(scope="module", params=["go2", "aliengo"])
def real(request: pytest.FixtureRequest, shared_data: Path) -> Identification:
    path = shared_data / "real" / f"{request.param}_legs_in_air.csv"
    if not path.is_file():
        pytest.skip(f"no real log: {path} does not exist")
    try:
        robot = load_robot(request.param)
    except MissingExtraError as error:
        pytest.skip(str(error))
    return identify(robot, [path])


def test_real_legs_are_no_worse_than_cad_with_friction(real: Identification) -> None:
    """On the held-out half, on every joint of every leg."""
    assert real.validated_on == "the last 50 % of the log"
    assert len(real.legs) == 4
    for leg in real.legs:
        errors = leg.rmse["validation"]
        for joint in leg.leg.joints:
            assert errors["identified"][joint] <= errors["prior_friction"][joint], joint
            assert errors["identified"][joint] < errors["prior"][joint], joint


def test_real_legs_are_physical(real: Identification) -> None:
    check_finite(real)
    assert real.is_physical
    for leg in real.legs:
        for link in leg.leg.links:
            assert leg.estimate.inertia(link).mass == pytest.approx(real.robot.inertias[link].mass)


def test_real_drives_lag_by_some_ten_milliseconds(real: Identification) -> None:
    assert 0.005 < real.torque_lag < 0.02


def test_a_joint_at_rest_has_no_friction_though_its_velocity_is_noisy() -> None:
    log, rng = exact_run(), np.random.default_rng(0)
    assert log.velocity is not None
    assert log.acceleration is not None
    moves = np.array([joint != "rh_kfe_joint" for joint in log.joints])
    position = np.where(moves, log.position, log.position[0] + 1e-4 * rng.standard_normal(log.position.shape))
    velocity = np.where(moves, log.velocity, 0.005 * rng.standard_normal(log.position.shape))
    part = replace(log, position=position, velocity=velocity, acceleration=moves * log.acceleration)
    result = identify(hyq(), [part], RH, force=True)
    found = result.legs[0].parameters
    assert all(found[f"rh_kfe_joint.{term}"].is_held for term in ("armature", "viscous", "coulomb"))
    assert not found["rh_hfe_joint.viscous"].is_held
    assert any("rh_kfe_joint" in warning and "friction do not show" in warning for warning in result.warnings)
