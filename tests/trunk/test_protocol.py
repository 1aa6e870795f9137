"""The value types of the online estimators."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from stadera.errors import ModelError, RecordingError, StaderaError, UnknownNameError
from stadera.inertia import InertialParameters
from stadera.lab.laws.equilibrium import ForceNoise
from stadera.lab.laws.static import MassEstimator
from stadera.lab.plant.plant import Plant
from stadera.lab.plant.sensors import IDEAL, SensorReading, Sensors, measurement_of, recording_of
from stadera.lab.plant.terrain import Terrain
from stadera.logs import Imu
from stadera.robot import Robot, load_robot
from stadera.robot.imu import ImuMount
from stadera.robot.stance import standing_configuration
from stadera.trunk import (
    Estimator,
    ImplausibleError,
    StaticLimits,
    Status,
    TrunkBounds,
    TrunkEstimate,
    TrunkModel,
    measurements_of,
    unobserved,
)


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_robot("hyq")


def shaken(robot: Robot, steps: int) -> tuple[list[SensorReading], list[Plant]]:
    """Samples of a robot that falls and turns."""
    plant, sensors = Plant(robot, Terrain(slope=0.36, heading=-2.0)), Sensors(IDEAL, 0, robot)
    plant.reset(standing_configuration(robot))
    samples = []
    for k in range(steps):
        plant.step(20.0 * np.sin(np.arange(12) + k))
        samples.append(sensors.read(plant))
    return samples, [plant]


@pytest.mark.parametrize(
    ("mass", "com"), [(0.0, [0, 0, 0]), (-1.0, [0, 0, 0]), (np.nan, [0, 0, 0]), (1.0, [np.nan, 0, 0]), (1.0, [0, 0])]
)
def test_impossible_trunks(mass: float, com: list[float]) -> None:
    with pytest.raises(ImplausibleError):
        TrunkModel(mass, np.array(com))


def test_bounds_name_what_is_wrong(robot: Robot) -> None:
    bounds, prior = TrunkBounds.of(robot), TrunkModel.prior(robot)
    assert bounds.complaint(prior) is None
    assert bounds.check(prior) is prior
    with pytest.raises(ImplausibleError, match=r"y = 0\.50"):
        bounds.check(TrunkModel(prior.mass, np.array([0.0, 0.5, 0.0])))
    with pytest.raises(ImplausibleError, match="mass"):
        bounds.check(TrunkModel(1e3, prior.com_trunk))
    with pytest.raises(ImplausibleError, match="low < high"):
        TrunkBounds((1.0, 2.0), bounds.high, bounds.low)


@pytest.mark.parametrize("name", ["h1", "g1", "talos"])
def test_a_box_on_the_back_of_a_humanoid_is_plausible(name: str) -> None:
    """30 % of the robot, half a leg above the hips: its trunk's centre of mass is above half of that already."""
    robot = load_robot(name)
    trunk, bounds = robot.inertias[robot.trunk], TrunkBounds.of(robot)
    box = InertialParameters.from_com(0.3 * robot.mass, np.array([-0.1, 0.0, 0.5 * robot.leg_length]), np.eye(3))
    assert bounds.complaint(TrunkModel.of(trunk + box)) is None


def test_measurement_in_trunk_axes(robot: Robot) -> None:
    """IMU turned and away from the origin: the trunk's own motion comes out, but for the angular acceleration."""
    samples, (plant,) = shaken(robot, 30)
    mount = ImuMount.of(robot)
    measurement, truth = measurement_of(samples[-1], mount), plant.state
    np.testing.assert_allclose(measurement.angular_velocity, truth.angular_velocity, atol=1e-12)
    np.testing.assert_allclose(measurement.rotation, truth.rotation, atol=1e-12)
    specific = truth.rotation.T @ (truth.linear_acceleration + np.array([0.0, 0.0, 9.81]))
    left_out = np.cross(truth.angular_acceleration, mount.translation)
    np.testing.assert_allclose(measurement.force_at_origin, specific + left_out, atol=1e-9)
    np.testing.assert_allclose(measurement.lever, mount.translation, atol=0.0)
    read = mount.rotation @ samples[-1].specific_force
    np.testing.assert_allclose(measurement.specific_force, read, atol=1e-12)
    np.testing.assert_allclose(measurement.up, truth.rotation[2], atol=1e-12)


def test_a_logs_measurements_are_those_of_its_samples(robot: Robot) -> None:
    samples, _ = shaken(robot, 20)
    mount = ImuMount.of(robot)
    for found, sample in zip(measurements_of(recording_of(samples, robot), robot), samples, strict=True):
        expected = measurement_of(sample, mount)
        assert found.time == expected.time
        for name in (
            "joint_position",
            "joint_velocity",
            "effort",
            "angular_velocity",
            "specific_force",
            "rotation",
            "lever",
        ):
            np.testing.assert_allclose(getattr(found, name), getattr(expected, name), atol=1e-12)


def test_without_orientation_up_is_the_specific_force(robot: Robot) -> None:
    samples, _ = shaken(robot, 3)
    log = recording_of(samples, robot)
    assert log.imu is not None
    blind = replace(log, imu=replace(log.imu, orientation=None))
    found = next(measurements_of(blind, robot))
    assert found.rotation is None
    np.testing.assert_allclose(np.linalg.norm(found.up), 1.0)
    np.testing.assert_allclose(np.cross(found.up, found.force_at_origin), 0.0, atol=1e-9)


def test_what_a_log_must_have(robot: Robot) -> None:
    samples, _ = shaken(robot, 3)
    log = recording_of(samples, robot)
    with pytest.raises(RecordingError, match="IMU"):
        next(measurements_of(replace(log, imu=None), robot))
    with pytest.raises(RecordingError, match="effort"):
        next(measurements_of(replace(log, effort=None), robot))
    with pytest.raises(UnknownNameError, match="IMU frame"):
        next(measurements_of(log, robot, imu_frame="head"))
    assert isinstance(log.imu, Imu)


def test_a_sample_that_is_not_finite(robot: Robot) -> None:
    samples, _ = shaken(robot, 2)
    for name in ("joint_position", "joint_velocity", "effort", "angular_velocity", "specific_force", "orientation"):
        for bad in (np.nan, np.inf):
            values = getattr(samples[-1], name).copy()
            values[1] = bad
            with pytest.raises(RecordingError, match="not finite"):
                measurement_of(replace(samples[-1], **{name: values}), ImuMount.of(robot))


def test_imu_on_a_leg_is_refused(robot: Robot) -> None:
    foot = robot.legs[0].foot
    with pytest.raises(ModelError, match="not to the trunk"):
        ImuMount.of(robot, foot)
    assert ImuMount.of(robot, robot.trunk).translation.any() == np.False_


def test_estimates_tell_what_was_observed(robot: Robot) -> None:
    covariance = unobserved()
    covariance[0, 0] = 0.04
    estimate = TrunkEstimate(1.0, TrunkModel.prior(robot), covariance, Status.MOVING)
    np.testing.assert_array_equal(estimate.observed, [True, False, False, False])
    assert estimate.std[0] == pytest.approx(0.2)
    assert estimate.value.shape == (4,)
    with pytest.raises(StaderaError, match="reason"):
        replace(estimate, status=Status.REFUSED)
    with pytest.raises(StaderaError, match="reason"):
        replace(estimate, reason="no reason")
    with pytest.raises(StaderaError, match=r"\(4, 4\)"):
        replace(estimate, covariance=np.zeros(4))


def test_settings_are_checked(robot: Robot) -> None:
    with pytest.raises(ModelError, match="torque_white"):
        ForceNoise(-np.ones(12), np.ones(12))
    with pytest.raises(ModelError, match="one value for each joint"):
        ForceNoise(np.ones(12), np.ones((4, 3)))
    with pytest.raises(StaderaError, match="slip"):
        StaticLimits(slip=0.0)
    assert isinstance(MassEstimator(robot), Estimator)
