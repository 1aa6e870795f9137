"""What every method of finding the trunk's centre of mass must do, fed by a robot that Pinocchio holds at rest."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from copy import deepcopy
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from stadera.errors import IdentificationError, UnknownNameError
from stadera.lab.baselines import ALL_METHODS
from stadera.lab.laws.orientation import PostureLaw
from stadera.lab.laws.poses import WIDE_FOOT, WIDE_TORQUE
from stadera.lab.laws.static_poses import PoseOffset, standing_still, static_poses
from stadera.robot import Robot, load_robot
from stadera.robot.kinematics import foot_positions
from stadera.robot.stance import standing_configuration
from stadera.trunk import Estimator, Measurement, Status, TrunkBounds, TrunkEstimate, TrunkModel
from stadera.trunk.error_model import ErrorLayout
from stadera.trunk.protocol import Weigher
from stadera.trunk.registry import Setup, make_estimator
from standing import GRAVITY, StandingRobot

ROBOT = load_robot("hyq")
STANCE = standing_configuration(ROBOT)
TRUTH = StandingRobot(ROBOT, 10.0, (-0.3, 0.15, 0.1))
STIFFNESS = np.array([1200.0, 2500.0, 2500.0])
POSTURE = PostureLaw(STIFFNESS, np.eye(3))
START = TrunkModel(58.0, np.array([0.12, -0.05, 0.0]))
BOUNDS = TrunkBounds.of(ROBOT)
DT = 0.02
LEVEL = PoseOffset()
SEEKS_HEIGHT = ("poses", "combined")


@dataclass(frozen=True, eq=False)
class Errors:
    """Constant errors of the sensors, and white noise of the torques."""

    torque: np.ndarray | float = 0.0
    white: np.ndarray | float = 0.0
    feet: np.ndarray | None = None


@cache
def poses_of(method: str) -> tuple[PoseOffset, ...]:
    return static_poses(ROBOT) if method in SEEKS_HEIGHT else (LEVEL,)


def stream(
    method: str,
    estimator: Estimator,
    *,
    poses: tuple[PoseOffset, ...] | None = None,
    seconds: float = 8.0,
    dt: float = DT,
    start: float = 0.0,
    errors: Errors | None = None,
    seed: int = 0,
) -> Iterator[Measurement]:
    """Measurements of the robot at rest, pose by pose; under the posture's law where the method weighs by that."""
    errors, rng = errors or Errors(), np.random.default_rng(seed)
    poses = poses_of(method) if poses is None else poses
    each = round(seconds / dt / len(poses))
    for k, pose in enumerate(poses):
        exact = at_pose(pose)
        feet = None if errors.feet is None else foot_positions(ROBOT, exact.joint_position[None])[0] + errors.feet
        for i in range(each):
            m = exact
            if method == "orientation":
                R = TRUTH.held(STANCE, believed(estimator.estimate().trunk), STIFFNESS, np.eye(3))
                m = TRUTH.measurement(0.0, STANCE, R)
            effort = m.effort + errors.torque + errors.white * rng.standard_normal(len(m.effort))
            yield replace(m, time=start + dt * (k * each + i), effort=effort, foot_position=feet)


@cache
def at_pose(pose: PoseOffset) -> Measurement:
    """By the package joint angles and the trunk's rotation alone, the rest by Pinocchio."""
    still = standing_still(ROBOT, pose)
    assert still is not None
    return TRUTH.measurement(0.0, still.joint_position, still.rotation)


def believed(trunk: TrunkModel) -> np.ndarray:
    """The whole robot's centre of mass if the trunk were as believed."""
    legs = TRUTH.mass - TRUTH.trunk_mass
    moment = TRUTH.mass * TRUTH.whole_com(STANCE) - TRUTH.trunk_mass * TRUTH.trunk_com
    return (trunk.mass * trunk.com_trunk + moment) / (trunk.mass + legs)


def made(method: str, start: TrunkModel = START) -> Weigher:
    return make_estimator(method, Setup(ROBOT, start, posture=POSTURE), ALL_METHODS)


def fed(method: str, **how: object) -> TrunkEstimate:
    estimator = made(method)
    for measurement in stream(method, estimator, **how):  # type: ignore[arg-type]
        estimator.update(measurement)
    return estimator.estimate()


@pytest.fixture(params=tuple(ALL_METHODS))
def method(request: pytest.FixtureRequest) -> str:
    return str(request.param)


def same(a: TrunkEstimate, b: TrunkEstimate) -> None:
    np.testing.assert_array_equal(a.value, b.value)
    np.testing.assert_array_equal(a.covariance, b.covariance)


def test_keeps_the_protocol_and_waits_with_what_it_was_given(method: str) -> None:
    estimator = made(method)
    assert isinstance(estimator, Estimator)
    estimate = estimator.estimate()
    assert estimate.status is Status.WAITING
    np.testing.assert_array_equal(estimate.value, [START.mass, *START.com_trunk])
    assert not estimate.observed.any()


def test_keeps_all_of_the_protocol(method: str) -> None:
    """Fed at once as sample by sample; tared, it knows that nothing was put on."""
    single, at_once = made(method), made(method)
    assert isinstance(single, Weigher)
    assert single.payload is None
    assert single.changes == ()
    assert single.trust.verdict == "doubtful"
    measured = list(stream(method, single, poses=(LEVEL,), seconds=3.0))
    half = len(measured) // 2
    for m in measured[:half]:
        single.update(m)
    at_once.add(measured[:half])
    same(single.estimate(), at_once.estimate())
    at_once.tare()
    at_once.add(measured[half:])
    found, trunk, payload = at_once.estimate(), at_once.trunk, at_once.payload
    np.testing.assert_array_equal([trunk.inertial.mass, *trunk.inertial.com], found.value)
    np.testing.assert_array_equal(trunk.covariance, found.covariance)
    np.testing.assert_array_equal(trunk.observed[:4], found.observed)
    assert payload is not None
    assert abs(payload.mass) < max(3.0 * payload.mass_std, 0.05)
    assert at_once.changes == ()
    assert at_once.trust.verdict in ("good", "doubtful")


def test_finds_the_known_centre_of_mass(method: str) -> None:
    estimate = fed(method, dt=2.0 * DT)
    assert estimate.status is Status.CONVERGED
    assert np.linalg.norm((estimate.trunk.com_trunk - TRUTH.trunk_com)[:2]) < 2e-4
    assert estimate.trunk.mass == pytest.approx(TRUTH.trunk_mass, rel=2e-3)
    if method in SEEKS_HEIGHT:
        assert estimate.trunk.com_trunk[2] == pytest.approx(TRUTH.trunk_com[2], abs=5e-4)
        assert estimate.observed.all()


def test_leaves_the_height_alone_where_the_trunk_is_level(method: str) -> None:
    estimate = fed(method, poses=(LEVEL,), seconds=3.0)
    assert estimate.trunk.com_trunk[2] == START.com_trunk[2] or method == "orientation"
    assert abs(estimate.trunk.com_trunk[2] - START.com_trunk[2]) < 0.01  # the trunk is not level before it is balanced
    assert np.isnan(estimate.covariance[3]).all()
    assert np.isnan(estimate.covariance[:, 3]).all()


def spoilt(m: Measurement, **what: object) -> Measurement:
    return replace(m, **what)  # type: ignore[arg-type]


def with_nan(values: np.ndarray) -> np.ndarray:
    bad = values.copy()
    bad.flat[-1] = np.nan
    return bad


def slipped(m: Measurement) -> Measurement:
    q = m.joint_position.copy()
    q[0] += 0.06  # the left fore foot goes sideways by some 4 cm
    return replace(m, joint_position=q)


BAD: dict[str, tuple[Callable[[Measurement], Measurement], str]] = {
    "position NaN": (lambda m: spoilt(m, joint_position=with_nan(m.joint_position)), "not finite"),
    "velocity NaN": (lambda m: spoilt(m, joint_velocity=with_nan(m.joint_velocity)), "not finite"),
    "effort NaN": (lambda m: spoilt(m, effort=with_nan(m.effort)), "not finite: effort of joint"),
    "effort infinite": (lambda m: spoilt(m, effort=m.effort + np.inf), "not finite"),
    "gyro NaN": (lambda m: spoilt(m, angular_velocity=with_nan(m.angular_velocity)), "not finite"),
    "accelerometer NaN": (lambda m: spoilt(m, specific_force=with_nan(m.specific_force)), "not finite"),
    "orientation NaN": (lambda m: spoilt(m, rotation=np.full((3, 3), np.nan)), "not finite: orientation"),
    "feet NaN": (lambda m: spoilt(m, foot_position=np.full((4, 3), np.nan)), "not finite: foot position"),
    "time back": (lambda m: spoilt(m, time=m.time - 1.0), "time must increase"),
    "moving": (lambda m: spoilt(m, joint_velocity=m.joint_velocity + 20.0), "moves at"),
    "turning": (lambda m: spoilt(m, angular_velocity=np.array([0.0, 10.0, 0.0])), "turns at"),
    "pushed": (lambda m: spoilt(m, specific_force=4.0 * m.specific_force), "accelerates"),
    "saturated": (lambda m: spoilt(m, effort=m.effort + 1e3 * np.eye(12)[4]), "at its limit"),
    "airborne": (lambda m: spoilt(m, effort=0.0 * m.effort), "0 feet carry"),
    "two feet": (lambda m: spoilt(m, stance=np.array([True, False, False, True])), "2 feet carry"),
    "slipped": (slipped, "slipped"),
}


ON_THE_MOVE = ("walking", "ls", "rls", "kalman")
"""Methods that do without rest, orientation, measured feet and a word on who carries."""
BASELINES = ("ls", "rls", "kalman")
AT_REST = ("orientation", "feet", "moving", "turning", "pushed", "saturated", "airborne", "two feet", "slipped")
"""What speaks against rest, or is no measurement of theirs."""


@cache
def after_a_second(method: str) -> tuple[Measurement, Weigher]:
    """The last sample, and what is learnt by then."""
    estimator = made(method)
    for m in stream(method, estimator, poses=(LEVEL,), seconds=1.0):
        estimator.update(m)
    return m, estimator


@pytest.mark.parametrize("what", BAD)
def test_refuses_with_a_reason_keeps_the_last_good_estimate_and_goes_on(
    method: str, what: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    spoil, words = BAD[what]
    if method in ON_THE_MOVE and what.startswith(AT_REST):
        pytest.skip(f"{method} does not ask for rest")
    m, known = after_a_second(method)
    for fixed in (Robot, ErrorLayout):  # which never change
        monkeypatch.setattr(fixed, "__deepcopy__", lambda it, _: it, raising=False)
    estimator = deepcopy(known)
    before = estimator.estimate()
    assert before.status in (Status.MOVING, Status.CONVERGED)
    estimator.update(spoil(replace(m, time=m.time + 1.5 * DT)))
    refused = estimator.estimate()
    assert refused.status is Status.REFUSED
    assert words in refused.reason
    same(before, refused)
    for m in stream(method, estimator, poses=(LEVEL,), seconds=1.0, start=1.0):
        estimator.update(m)
    after = estimator.estimate()
    assert after.status in (Status.MOVING, Status.CONVERGED)
    assert after.time > before.time


@settings(max_examples=10, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(seed=st.integers(0, 2**32 - 1), size=st.sampled_from([1.0, 10.0, 60.0, 300.0]))
def test_never_believes_what_cannot_be(method: str, seed: int, size: float) -> None:
    rng, estimator = np.random.default_rng(seed), made(method)
    exact = TRUTH.measurement(0.0, STANCE)
    wrong = size * rng.standard_normal(12)
    for k in range(60):
        effort = exact.effort + wrong + 0.1 * size * rng.standard_normal(12)
        estimator.update(replace(exact, time=DT * k, effort=effort))
        trunk = estimator.estimate().trunk
        assert BOUNDS.complaint(trunk) is None
        assert trunk.mass > 0


def test_an_estimate_that_runs_away_is_named(method: str) -> None:
    """The legs carry less than any trunk could weigh."""
    trunk = ROBOT.inertias[ROBOT.trunk]
    x, y, z = trunk.com
    hollow, estimator, time = StandingRobot(ROBOT, -0.95 * trunk.mass, (x, y, z)), made(method), 0.0
    for pose in poses_of(method):
        there = hollow.measurement(0.0, at_pose(pose).joint_position, at_pose(pose).rotation)
        for _ in range(round(5.0 / DT / len(poses_of(method)))):
            time += 2.0 * DT
            estimator.update(replace(there, time=time))
    estimate = estimator.estimate()
    assert estimate.status is Status.REFUSED
    assert "runs away: trunk mass" in estimate.reason
    assert BOUNDS.complaint(estimate.trunk) is None


@pytest.mark.parametrize("seeds", [range(10)])
def test_is_as_sure_as_it_may_be(method: str, seeds: range) -> None:
    if method in BASELINES:
        pytest.skip(f"the covariance of the baseline {method} knows nothing of constant errors")
    limit = np.array([ROBOT.limits[joint].effort for joint in ROBOT.tree.joints])
    wide = method == "combined"
    squares, count = 0.0, 0
    for seed in seeds:
        rng = np.random.default_rng(1000 + seed)
        errors = Errors(
            torque=(0.4 * WIDE_TORQUE if wide else 0.0033) * limit * rng.standard_normal(12),
            white=0.0033 * limit,
            feet=0.4 * WIDE_FOOT * rng.standard_normal((4, 3)) if wide else None,
        )
        poses = poses_of(method) if wide else poses_of(method)[:5]
        estimate = fed(
            method, errors=errors, seed=seed, poses=poses, seconds=8.0 if wide else max(3.0, len(poses)), dt=0.04
        )
        seen = estimate.observed
        off = (estimate.value - np.array([TRUTH.trunk_mass, *TRUTH.trunk_com]))[seen]
        squares += float(off @ np.linalg.solve(estimate.covariance[np.ix_(seen, seen)], off))
        count += int(seen.sum())
    # squares is chi-squared of `count` degrees: within four of its standard deviations
    slack = 4.0 * np.sqrt(2.0 / count)
    assert squares / count < 1.0 + slack
    if method in ("poses", "contact"):
        assert squares / count > 1.0 - slack


def test_neither_the_clock_nor_being_asked_changes_it(method: str) -> None:
    quiet, asked, later = made(method), made(method), made(method)
    how = {"seconds": 2.0, "dt": 2.0**-5}
    for measurement in stream(method, quiet, **how):  # type: ignore[arg-type]
        quiet.update(measurement)
    for measurement in stream(method, asked, **how):  # type: ignore[arg-type]
        for _ in range(2):
            asked.estimate()
        asked.update(measurement)
    for measurement in stream(method, later, start=4096.0, **how):  # type: ignore[arg-type]
        later.update(measurement)
    same(quiet.estimate(), asked.estimate())
    np.testing.assert_allclose(quiet.estimate().value, later.estimate().value, rtol=0, atol=1e-9)


def test_the_rate_of_samples_does_not_matter(method: str) -> None:
    slow, fast = fed(method, dt=0.02, seconds=6.0), fed(method, dt=0.005, seconds=6.0)
    np.testing.assert_allclose(slow.value[:3], fast.value[:3], atol=2e-3)


def test_refuses_a_start_that_cannot_be(method: str) -> None:
    from stadera.trunk import ImplausibleError

    with pytest.raises(ImplausibleError):
        made(method, TrunkModel(50.0, np.array([2.0, 0.0, 0.0])))


def test_an_unknown_method_is_told_the_valid_ones() -> None:
    with pytest.raises(UnknownNameError, match="poses"):
        make_estimator("contacts", Setup(ROBOT))


def test_the_orientation_method_needs_a_posture() -> None:
    with pytest.raises(IdentificationError, match="stiffness"):
        make_estimator("orientation", Setup(ROBOT))


def test_the_reference_robot_carries_its_weight() -> None:
    """The fixture itself: forces from its torques hold the weight, by virtual work of a lift of the trunk."""
    effort = TRUTH.efforts(STANCE, np.eye(3))
    step = 1e-6
    feet = foot_positions(ROBOT, STANCE[None])[0]
    from standing import foot_jacobians

    J = foot_jacobians(ROBOT, STANCE[None])[0]
    columns = np.array([[ROBOT.tree.joints.index(j) for j in leg.joints] for leg in ROBOT.legs])
    down = np.linalg.solve(J, np.tile([0.0, 0.0, -step], (4, 1))[:, :, None])[:, :, 0]
    q = STANCE.copy()
    q[columns] += down
    np.testing.assert_allclose(foot_positions(ROBOT, q[None])[0], feet - [0, 0, step], atol=1e-9)
    lifted = step * TRUTH.trunk_mass
    before, after = (TRUTH.mass * TRUTH.whole_com(x)[2] for x in (STANCE, q))
    rise = lifted * TRUTH.mass / TRUTH.trunk_mass + after - before  # of Σ m z, with the feet where they are
    work = sum(float(effort[columns[leg]] @ down[leg]) for leg in range(4))
    assert work == pytest.approx(GRAVITY * rise, rel=1e-3)
