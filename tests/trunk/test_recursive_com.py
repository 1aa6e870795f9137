"""The feedback laws (b) and (c): signs, slopes, heights, and settling as predicted."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from stadera.errors import IdentificationError
from stadera.lab.laws.orientation import OrientationCom, PostureLaw
from stadera.lab.laws.recursive import ContactCom, LawSettings, Settled, settling_time, step_size
from stadera.robot import load_robot
from stadera.robot.stance import standing_configuration
from stadera.trunk import Measurement, Status, TrunkModel
from standing import StandingRobot

ROBOT = load_robot("hyq")
STANCE = standing_configuration(ROBOT)
TRUTH = StandingRobot(ROBOT, 10.0, (-0.3, 0.15, 0.1))
STIFFNESS = np.array([1200.0, 2500.0, 2500.0])
LEVEL = np.eye(3)


def off(x: float, y: float, z: float = 0.0) -> TrunkModel:
    """A belief that is off by that much [m], its mass right."""
    return TrunkModel(TRUTH.trunk_mass, TRUTH.trunk_com + np.array([x, y, z]))


def whole(trunk: TrunkModel) -> np.ndarray:
    moment = TRUTH.mass * TRUTH.whole_com(STANCE) - TRUTH.trunk_mass * TRUTH.trunk_com
    return (trunk.mass * trunk.com_trunk + moment) / (trunk.mass + TRUTH.mass - TRUTH.trunk_mass)


def sprung(estimator: OrientationCom, time: float, belief: TrunkModel | None = None) -> Measurement:
    """The robot at rest under the law that the estimator knows, with its own belief or another."""
    believed = whole(estimator.estimate().trunk if belief is None else belief)
    return TRUTH.measurement(time, STANCE, TRUTH.held(STANCE, believed, STIFFNESS, estimator.reference))


def pitched(degrees: float) -> np.ndarray:
    return np.asarray(Rotation.from_euler("y", degrees, degrees=True).as_matrix())


def error(estimator: ContactCom | OrientationCom) -> np.ndarray:
    return estimator.estimate().trunk.com_trunk - TRUTH.trunk_com


# -- settling -----------------------------------------------------------------------------------------------------
@given(step=st.floats(1e-5, 0.9), period=st.floats(1e-4, 1.0))
def test_step_and_settling_time_are_each_others_inverse(step: float, period: float) -> None:
    settling = settling_time(step, period)
    assert step_size(settling, period) == pytest.approx(step, rel=1e-9)
    # the sequence itself, by repeated steps of whole periods
    left = (1.0 - step) ** (settling / period)
    assert left == pytest.approx(np.exp(-3.0), rel=1e-6)


def test_the_papers_step_settles_in_one_and_a_half_seconds() -> None:
    assert settling_time() == pytest.approx(1.4985, abs=1e-4)


@pytest.mark.parametrize("settling", [0.5, 1.5])
def test_contact_settles_when_predicted(settling: float) -> None:
    estimator, exact = (
        ContactCom(ROBOT, off(0.1, -0.05), settings=LawSettings(settling=settling)),
        TRUTH.measurement(0.0, STANCE),
    )
    before = np.linalg.norm(error(estimator)[:2])
    begun, measured = None, np.nan
    for k in range(round(4.0 * settling / 0.002)):
        time = 0.002 * k
        estimator.update(replace(exact, time=time))
        left = np.linalg.norm(error(estimator)[:2]) / before
        if begun is None and left < 1.0:
            begun = time - 0.002
        if begun is not None and np.isnan(measured) and left <= 0.05:
            measured = time - begun
    assert measured == pytest.approx(settling, rel=0.02)


def test_orientation_settles_when_predicted() -> None:
    posture = PostureLaw(STIFFNESS, LEVEL)
    estimator = OrientationCom(ROBOT, posture, off(0.06, -0.04), settings=LawSettings(settling=1.5))
    before = np.linalg.norm(error(estimator)[:2])
    begun, measured = None, np.nan
    for k in range(250):
        time = 0.02 * k
        estimator.update(sprung(estimator, time))
        left = np.linalg.norm(error(estimator)[:2]) / before
        if begun is None and left < 1.0:
            begun = time - 0.02
        if begun is not None and np.isnan(measured) and left <= 0.05:
            measured = time - begun
    assert measured == pytest.approx(1.5, rel=0.05)


def test_converges_by_the_papers_rule() -> None:
    estimator, exact = ContactCom(ROBOT, off(0.1, -0.05)), TRUTH.measurement(0.0, STANCE)
    for k in range(4000):
        estimator.update(replace(exact, time=0.002 * k))
        if estimator.estimate().status is Status.CONVERGED:
            break
    assert 0.0002 < np.linalg.norm(error(estimator)[:2]) < 0.0005 * 1.05


def test_settled_means_the_mean_innovation_not_one_sample() -> None:
    rule = Settled(5e-4)
    rule.take(np.zeros(3), 0.002)
    assert not rule.reached
    for _ in range(2000):
        rule.take(np.array([1e-4, 0.0, 0.0]), 0.002)
    assert rule.reached
    for _ in range(2000):
        rule.take(np.array([1e-3, 0.0, 0.0]), 0.002)
    assert not rule.reached


def test_noise_alone_does_not_keep_it_from_settling_nor_hide_a_way_to_go() -> None:
    """Innovations of 9 mm noise at 100 Hz: their running mean is off by 2 mm for ever."""
    rng, step = np.random.default_rng(8), step_size(1.5, 0.01)
    at_rest, moving = Settled(5e-4), Settled(5e-4)
    reached = []
    for _ in range(1000):
        noise = 0.009 * rng.standard_normal(3) / np.sqrt(3.0)
        at_rest.take(noise, step)
        moving.take(noise + np.array([0.01, 0.0, 0.0]), step)
        reached.append((at_rest.reached, moving.reached))
    settled, hidden = np.mean(reached[100:], axis=0)
    assert settled > 0.9
    assert hidden == 0.0


# -- contact forces -------------------------------------------------------------------------------------------------
@settings(max_examples=5, deadline=None)
@given(roll=st.floats(-0.12, 0.12), pitch=st.floats(-0.12, 0.12), yaw=st.floats(-3.0, 3.0))
def test_contact_finds_the_plane_on_any_slope(roll: float, pitch: float, yaw: float) -> None:
    rotation = Rotation.from_euler("zyx", [yaw, pitch, roll]).as_matrix()
    exact = TRUTH.measurement(0.0, STANCE, rotation)
    estimator = ContactCom(ROBOT, off(0.05, -0.03, 0.02), settings=LawSettings(settling=0.3))
    for k in range(200):
        estimator.update(replace(exact, time=0.01 * k, rotation=rotation if k % 2 else None))
    left = rotation @ error(estimator)
    np.testing.assert_allclose(left[:2], 0.0, atol=2e-6)
    # the height in the trunk stays as it was believed
    assert error(estimator)[2] == pytest.approx(0.02, abs=1e-9)


def test_on_a_slope_the_trunks_plane_does_not_depend_on_where_x_and_y_began() -> None:
    slope = Rotation.from_euler("y", -15.0, degrees=True).as_matrix()
    exact = TRUTH.measurement(0.0, STANCE, slope)
    for x in (-0.1, 0.1):
        estimator = ContactCom(ROBOT, off(x, 0.05), settings=LawSettings(settling=0.3))
        for k in range(200):
            estimator.update(replace(exact, time=0.01 * k))
        np.testing.assert_allclose(error(estimator), 0.0, atol=2e-6)


@pytest.mark.parametrize("slope", [0.0, 12.0])
def test_contact_finds_the_height_once_tilted(slope: float) -> None:
    first, second = (TRUTH.measurement(0.0, STANCE, pitched(-slope + more)) for more in (0.0, 10.0))
    estimator = ContactCom(ROBOT, off(0.05, -0.03, 0.04), settings=LawSettings(settling=0.5))
    with pytest.raises(IdentificationError, match="converged"):
        estimator.look_for_height()
    for k in range(250):
        estimator.update(replace(first, time=0.01 * k))
    assert not estimator.estimate().observed[3]
    estimator.look_for_height()
    estimator.update(replace(first, time=2.5))
    assert "tilted by 3°" in estimator.estimate().reason
    for k in range(251, 500):
        estimator.update(replace(second, time=0.01 * k))
    estimate = estimator.estimate()
    assert estimate.status is Status.CONVERGED
    np.testing.assert_allclose(error(estimator), 0.0, atol=2e-6)
    assert estimate.observed.all()


def test_two_poses_are_as_sure_of_the_height_as_they_may_be() -> None:
    """Constant errors of the torques alone: their variance in 40 draws against the covariance stated."""
    limit = np.array([ROBOT.limits[joint].effort for joint in ROBOT.tree.joints])
    first, second = TRUTH.measurement(0.0, STANCE, pitched(-10.0)), TRUTH.measurement(0.0, STANCE, pitched(2.0))
    rng, squares = np.random.default_rng(5), []
    for _ in range(40):
        offset = 0.0033 * limit * rng.standard_normal(12)
        estimator = ContactCom(ROBOT, off(0.0, 0.0), settings=LawSettings(settling=0.1))
        for k in range(40):
            m = first if k < 20 else second
            estimator.update(replace(m, time=0.02 * k, effort=m.effort + offset))
            if k == 19:
                estimator.look_for_height()
        estimate = estimator.estimate()
        off_by = estimate.value - [TRUTH.trunk_mass, *TRUTH.trunk_com]
        squares.append(off_by @ np.linalg.solve(estimate.covariance, off_by))
    assert np.mean(squares) == pytest.approx(4.0, abs=4.0 * np.sqrt(8.0 / 40))


# -- orientation ----------------------------------------------------------------------------------------------------
@pytest.mark.parametrize(("x", "y"), [(0.04, 0.0), (-0.04, 0.0), (0.0, 0.03), (0.0, -0.03), (0.03, -0.02)])
def test_orientation_steps_the_right_way(x: float, y: float) -> None:
    estimator = OrientationCom(ROBOT, PostureLaw(STIFFNESS, LEVEL), off(x, y))
    first = sprung(estimator, 0.0)
    assert first.rotation is not None
    # belief too far ahead: the compensation lifts the nose, which is a negative pitch
    assert np.sign(np.round(-first.rotation[2, 0], 6)) == -np.sign(x)
    for k in range(20):
        estimator.update(sprung(estimator, 0.02 * k))
    shrunk = error(estimator)[:2] / np.array([x or 1.0, y or 1.0])
    for part, given_ in zip(shrunk, (x, y), strict=True):
        assert part < 0.9 if given_ else abs(part) < 1e-3


def test_orientation_finds_the_height_once_tilted() -> None:
    estimator = OrientationCom(
        ROBOT, PostureLaw(STIFFNESS, LEVEL), off(0.05, -0.03, 0.04), settings=LawSettings(settling=1.0)
    )
    tilted = Rotation.from_euler("y", 10.0, degrees=True).as_matrix()
    with pytest.raises(IdentificationError, match="converged"):
        estimator.look_for_height(tilted)
    for k in range(200):
        estimator.update(sprung(estimator, 0.02 * k))
    assert estimator.estimate().status is Status.CONVERGED
    assert error(estimator)[2] > 0.03
    estimator.look_for_height(tilted)
    for k in range(200, 450):
        estimator.update(sprung(estimator, 0.02 * k))
    estimate = estimator.estimate()
    assert estimate.status is Status.CONVERGED
    np.testing.assert_allclose(error(estimator), 0.0, atol=3e-4)
    assert estimate.observed.all()
    # a constant error of the orientation is the same in both phases, and nearly cancels in the height
    assert estimate.std[3] < 0.05


def test_orientation_works_with_a_controller_that_keeps_its_belief() -> None:
    start = off(0.04, -0.03)
    estimator = OrientationCom(
        ROBOT, PostureLaw(STIFFNESS, LEVEL, feeds_back=False), start, settings=LawSettings(settling=0.5)
    )
    for k in range(150):
        estimator.update(sprung(estimator, 0.02 * k, belief=start))
    np.testing.assert_allclose(error(estimator)[:2], 0.0, atol=3e-4)


def test_orientation_says_when_there_is_none() -> None:
    estimator = OrientationCom(ROBOT, PostureLaw(STIFFNESS, LEVEL))
    for k in range(20):
        estimator.update(replace(TRUTH.measurement(0.02 * k, STANCE), rotation=None))
    assert estimator.estimate().reason.startswith("no orientation")
