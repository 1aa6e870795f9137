"""The gate before every law of statics: pushes across the vertical, values that are not finite, gaps."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from stadera.lab.laws.poses import SETTLED
from stadera.lab.laws.static import MassEstimator
from stadera.lab.scenarios.catalog import SimulateSettings
from stadera.lab.scenarios.run import simulate
from stadera.logs.recording import take
from stadera.robot import load_robot
from stadera.robot.stance import standing_configuration
from stadera.trunk import ContactForceEstimator, Measurement, StaticDetector, StaticLimits, Status, TrunkBounds
from stadera.trunk.measurement import measurements_of
from stadera.trunk.samples import Samples
from stadera.trunk.standing.detection import VelocityNoise
from stadera.trunk.standing.estimator import StandingEstimator
from stadera.trunk.standing.forces import measurements_without_imu
from standing import StandingRobot

ROBOT = load_robot("hyq")
STANCE = standing_configuration(ROBOT)
AT_REST = StandingRobot(ROBOT).measurement(0.0, STANCE)
FORCES = ContactForceEstimator(ROBOT)
DT = 0.01


def said(gate: StaticDetector, measurements: list[Measurement]) -> list[str]:
    return [gate.unusable(m) or gate.complaint(m, FORCES.at(AT_REST)) for m in measurements]


def at_rest(count: int, start: float = 0.0) -> list[Measurement]:
    return [replace(AT_REST, time=start + DT * k) for k in range(count)]


def nan_in(name: str) -> Callable[[Measurement], Measurement]:
    def spoil(m: Measurement) -> Measurement:
        values = getattr(m, name).copy()
        values.flat[-1] = np.nan
        return replace(m, **{name: values})

    return spoil


@pytest.mark.parametrize("oriented", [True, False])
def test_a_push_across_the_vertical_is_noticed(oriented: bool) -> None:
    """By 0.8 m/s², the specific force's size changes by 0.03 m/s² only."""
    gate = StaticDetector(FORCES.robot)
    rotation = AT_REST.rotation if oriented else None
    quiet = [replace(m, rotation=rotation) for m in at_rest(60)]
    assert said(gate, quiet)[-1] == ""
    pushed = AT_REST.specific_force + np.array([0.8, 0.0, 0.0])
    assert abs(np.linalg.norm(pushed) - 9.81) < 0.04
    reasons = said(gate, [replace(m, time=m.time + 0.6, specific_force=pushed) for m in quiet[:20]])
    assert any("across the vertical" in reason for reason in reasons)


@pytest.mark.parametrize("oriented", [True, False])
def test_a_constant_error_of_the_accelerometer_or_a_slow_turn_is_no_push(oriented: bool) -> None:
    """Turning at 0.2 rad/s, which these limits allow, the vertical is carried along."""
    gate = StaticDetector(FORCES.robot, StaticLimits(angular_velocity=0.3))
    measurements = []
    for k, m in enumerate(at_rest(150)):
        R = Rotation.from_rotvec([0.0, 0.2 * DT * k, 0.0]).as_matrix()
        force = 9.81 * R[2] + np.array([0.1, 0.0, 0.0])
        measurements.append(
            replace(
                m,
                rotation=R if oriented else None,
                specific_force=force,
                angular_velocity=np.array([0.0, 0.2, 0.0]),
            )
        )
    assert said(gate, measurements)[15:] == [""] * 135


def test_the_accelerometers_scale_is_no_push() -> None:
    """Go2s at rest read 9.5 m/s²; another 0.5 m/s² for a while is a push, and 9 m/s² is no sensor's scale."""

    def at(size: float, start: float = 0.0) -> list[Measurement]:
        return [replace(m, specific_force=m.specific_force * size / 9.81) for m in at_rest(60, start)]

    gate = StaticDetector(FORCES.robot)
    assert said(gate, at(9.5))[15:] == [""] * 45
    assert any("specific force changes by +0.2" in reason for reason in said(gate, at(10.0, 0.6)[:20]))
    assert (
        said(StaticDetector(FORCES.robot), at(9.0))[-1]
        == "the trunk accelerates: specific force -0.81 m/s² off gravity"
    )


@pytest.mark.parametrize(
    "name", ["joint_position", "joint_velocity", "effort", "angular_velocity", "specific_force", "rotation"]
)
def test_a_value_that_is_not_finite_is_named_and_forgotten(name: str) -> None:
    gate = StaticDetector(FORCES.robot)
    assert said(gate, at_rest(30))[-1] == ""
    (reason,) = said(gate, [nan_in(name)(replace(AT_REST, time=0.305))])
    assert reason.startswith("not finite: " + ("orientation" if name == "rotation" else name.replace("_", " ")))
    assert said(gate, at_rest(30, 0.31))[-1] == ""


def test_an_arms_value_is_not_named_after_a_joint_of_a_leg() -> None:
    """Four joints of an arm have as many values as twelve joints of legs."""
    extra = np.array([*np.zeros(11), np.nan])
    (reason,) = said(StaticDetector(FORCES.robot), [replace(AT_REST, extra=extra)])
    assert reason == "not finite: other joints"


def test_torques_too_large_to_be_added_up_are_beyond_their_limits() -> None:
    with np.errstate(over="ignore"):
        (reason,) = said(StaticDetector(FORCES.robot), [replace(AT_REST, effort=np.full(12, 1e308))])
    assert "at its limit" in reason


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (nan_in("effort"), "not finite: effort of joint"),
        (nan_in("specific_force"), "not finite: specific force"),
        (lambda m: replace(m, time=np.nan), "not finite: time"),
        (lambda m: replace(m, time=m.time - 1.0), "time must increase"),
        (lambda m: replace(m, stance=np.array([True, False, False, True])), "only 2 feet carry"),
        (lambda m: replace(m, effort=m.effort + 1e3 * np.eye(12)[4]), "at its limit"),
    ],
)
def test_the_mass_is_kept_through_bad_input(spoil: Callable[[Measurement], Measurement], words: str) -> None:
    estimator = MassEstimator(ROBOT)
    for m in at_rest(60):
        estimator.update(m)
    before = estimator.estimate()
    assert before.status is not Status.REFUSED
    estimator.update(spoil(replace(AT_REST, time=0.605)))
    refused = estimator.estimate()
    assert refused.status is Status.REFUSED
    assert words in refused.reason
    np.testing.assert_array_equal(refused.value, before.value)
    np.testing.assert_array_equal(refused.covariance, before.covariance)
    for m in at_rest(60, 0.61):
        estimator.update(m)
    after = estimator.estimate()
    assert after.status is not Status.REFUSED
    assert after.trunk.mass == pytest.approx(before.trunk.mass, rel=1e-9)
    assert TrunkBounds.of(ROBOT).complaint(after.trunk) is None


def test_times_at_rest_name_what_is_not_finite_and_go_on() -> None:
    measurements = at_rest(200)
    measurements[100] = nan_in("joint_velocity")(measurements[100])
    rest = StandingEstimator(ROBOT)
    rest.add(measurements[:100])
    before = rest.estimate()
    rest.add(measurements[100:101])
    assert rest.refusal.startswith("not finite: joint velocity of joint")
    rest.add(measurements[101:])
    assert rest.refusal == ""
    after = rest.estimate()
    assert after.time > 1.9
    assert after.trunk.mass == pytest.approx(before.trunk.mass, rel=1e-3)


def test_a_table_of_samples_passes_the_gate_too() -> None:
    """Joints that move at twice the limit are no rest, whichever way their samples come."""
    moving = [replace(m, joint_velocity=m.joint_velocity + 2.0 * StaticLimits().joint_velocity) for m in at_rest(100)]
    rest = StandingEstimator(ROBOT)
    assert list(rest.learning(Samples.of(moving).table)) == [m.time for m in moving]
    assert "moves at" in rest.refusal
    assert np.isnan(rest.estimate().time)


def noisy(rate: float, seconds: float, std: float, moving: float = 0.0, seed: int = 0) -> list[Measurement]:
    """Of a robot at rest with noisy joint velocities; one joint moves [rad/s]."""
    draws = std * np.random.default_rng(seed).standard_normal((int(rate * seconds), len(STANCE)))
    draws[:, 4] += moving
    return [replace(AT_REST, time=k / rate, joint_velocity=draw) for k, draw in enumerate(draws)]


@pytest.mark.parametrize("rate", [50.0, 100.0, 1000.0])
@pytest.mark.parametrize("std", [0.0, 0.04])
def test_rest_and_motion_are_told_alike_at_every_rate(rate: float, std: float) -> None:
    """The limit is of motion, whatever the noise and however often it is sampled."""
    for moving in (0.0, 1.5 * SETTLED.joint_velocity):
        reasons = said(StaticDetector(FORCES.robot, SETTLED), noisy(rate, 5.0, std, moving))[int(2.0 * rate) :]
        still = np.mean([not reason for reason in reasons])
        if not moving:
            assert still > 0.95
        else:
            assert still < 0.02
            assert any("moves at" in reason for reason in reasons)


@pytest.mark.parametrize("rate", [50.0, 1000.0])
def test_noise_of_velocities_is_heard_beside_motion(rate: float) -> None:
    noise, std = VelocityNoise(), 0.02
    time = np.arange(0.0, 6.0, 1.0 / rate)
    draws = std * np.random.default_rng(1).standard_normal((len(time), 12))
    swing = np.where(time < 2.0, np.sin(9.0 * time), 0.0)  # a walk, then rest
    for velocity in draws + swing[:, None]:
        noise.update(velocity, 1.0 / rate)
    assert np.sqrt(noise.variance) == pytest.approx(std, rel=0.2)


def test_a_simulated_stand_is_at_rest_with_and_without_imu() -> None:
    fast = simulate(ROBOT, "stand", SimulateSettings(duration=3.0, rate=100.0, seed=5)).recording
    for every, made in itertools.product((1, 2), (measurements_of, measurements_without_imu)):
        gate = StaticDetector(FORCES.robot, SETTLED)
        log = take(fast, slice(None, None, every))
        still = [m.time for m in made(log, ROBOT) if not gate.complaint(m, FORCES.at(m))]
        assert still[0] < 1.2
        assert len(still) > 0.95 * (100.0 / every) * (3.0 - still[0])
