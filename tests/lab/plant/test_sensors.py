"""Sensors: the errors have the sizes and the kinds that were asked for."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from stadera.constants import GRAVITY
from stadera.lab.plant.plant import Plant
from stadera.lab.plant.sensors import (
    HARSH,
    IDEAL,
    STANDARD,
    Gaussian,
    SensorErrors,
    SensorReading,
    Sensors,
    estimator_model,
    measured,
    plant_model,
)
from stadera.logs import Recording
from stadera.robot import JointLimits, Robot, load_robot
from stadera.robot.imu import ImuMount
from stadera.robot.kinematics import foot_positions
from stadera.robot.stance import standing_configuration


@pytest.fixture(scope="module")
def hyq() -> Robot:
    return load_robot("hyq")


@pytest.fixture(scope="module")
def still(hyq: Robot) -> Plant:
    """A plant at one instant, which sensors may read over and over."""
    plant = Plant(hyq)
    plant.reset(standing_configuration(hyq))
    plant.step(np.linspace(-20.0, 20.0, 12))
    return plant


def stacked(samples: list[SensorReading], name: str) -> np.ndarray:
    return np.array([getattr(sample, name) for sample in samples])


def imu_rotation(plant: Plant, robot: Robot) -> Rotation:
    return Rotation.from_quat(plant.state.orientation) * Rotation.from_matrix(ImuMount.of(robot).rotation)


def test_ideal_sensors_tell_the_truth(hyq: Robot, still: Plant) -> None:
    sample, state = Sensors(IDEAL, 0, hyq).read(still), still.state
    np.testing.assert_array_equal(sample.joint_position, state.joint_position)
    np.testing.assert_array_equal(sample.joint_velocity, state.joint_velocity)
    np.testing.assert_array_equal(sample.effort, np.linspace(-20.0, 20.0, 12))
    np.testing.assert_allclose(np.r_[sample.angular_velocity, sample.specific_force], still.imu_motion, atol=1e-14)
    error = Rotation.from_quat(sample.orientation) * imu_rotation(still, hyq).inv()
    assert error.magnitude() < 1e-12
    assert sample.foot_position is None
    assert sample.time == state.time


def test_white_noise_and_constants_of_the_standard_set(hyq: Robot, still: Plant) -> None:
    runs = [[sensors.read(still) for _ in range(60)] for sensors in (Sensors(STANDARD, s, hyq) for s in range(60))]
    limit = np.array([hyq.limits[joint].effort for joint in hyq.tree.joints])
    truth = {
        "joint_position": (still.joint_position, STANDARD.position, 0.0),
        "joint_velocity": (still.joint_velocity, STANDARD.velocity, 0.0),
        "effort": (still.effort, STANDARD.torque * limit, STANDARD.torque_constant * limit),
        "angular_velocity": (still.imu_motion[:3], STANDARD.gyro, STANDARD.gyro_constant),
        "specific_force": (still.imu_motion[3:], STANDARD.accelerometer, STANDARD.accelerometer_constant),
    }
    for name, (true, white, constant) in truth.items():
        errors = np.array([stacked(run, name) for run in runs]) - true  # runs, samples, components
        within = errors - errors.mean(axis=1, keepdims=True)
        size = np.sqrt((within**2).mean(axis=(0, 1)) * 60 / 59)
        np.testing.assert_allclose(size, white, rtol=0.1, err_msg=name)
        between = np.sqrt(((errors.mean(axis=1) ** 2) / np.square(np.maximum(constant, white / 60**0.5))).mean())
        assert between == pytest.approx(1.0, abs=0.25), name


def test_orientation_is_off_by_a_constant_of_the_run(hyq: Robot, still: Plant) -> None:
    true = imu_rotation(still, hyq)
    turns = []
    for seed in range(100):
        sensors = Sensors(STANDARD, seed, hyq)
        first, later = sensors.read(still), sensors.read(still)
        np.testing.assert_array_equal(first.orientation, later.orientation)
        turns.append((true.inv() * Rotation.from_quat(first.orientation)).as_rotvec())
    np.testing.assert_allclose(np.std(turns, axis=0), np.deg2rad(0.2), rtol=0.25)


def test_crooked_imu_turns_everything_alike(hyq: Robot, still: Plant) -> None:
    errors = SensorErrors(imu_misalignment=np.deg2rad(0.5))
    sample = Sensors(errors, 3, hyq).read(still)
    mounting = imu_rotation(still, hyq).inv() * Rotation.from_quat(sample.orientation)
    assert np.rad2deg(mounting.magnitude()) == pytest.approx(0.5, abs=1e-9)
    np.testing.assert_allclose(mounting.apply(sample.specific_force), still.imu_motion[3:], atol=1e-12)
    np.testing.assert_allclose(mounting.apply(sample.angular_velocity), still.imu_motion[:3], atol=1e-12)


def test_torques_arrive_late(hyq: Robot) -> None:
    plant, sensors = Plant(hyq), Sensors(SensorErrors(torque_delay=0.003), 0, hyq)
    plant.reset(standing_configuration(hyq))
    applied, read = [], []
    for k in range(12):
        plant.step(np.full(12, float(k)))
        applied.append(plant.effort)
        read.append(sensors.read(plant).effort)
    np.testing.assert_array_equal(read[3:], applied[:-3])
    np.testing.assert_array_equal(read[:3], [applied[0]] * 3)
    plant.reset(standing_configuration(hyq))
    np.testing.assert_array_equal(sensors.read(plant).effort, plant.effort)


@pytest.mark.parametrize("drawn", ["run", "sample"])
def test_torque_offsets_of_table_four(hyq: Robot, still: Plant, drawn: str) -> None:
    runs = [Sensors(SensorErrors(torque_offset=Gaussian(10.0, 1.0, drawn)), seed, hyq) for seed in range(30)]
    errors = np.array([stacked([s.read(still) for _ in range(10)], "effort") for s in runs]) - still.effort
    assert errors.mean() == pytest.approx(10.0, abs=0.2)
    assert errors.std() == pytest.approx(1.0, abs=0.15)
    assert (np.ptp(errors, axis=1).max() < 1e-12) == (drawn == "run")


@pytest.mark.parametrize("drawn", ["run", "sample"])
def test_foot_positions_of_table_four(hyq: Robot, still: Plant, drawn: str) -> None:
    runs = [Sensors(SensorErrors(foot_position=Gaussian(0.0, 0.02, drawn)), seed, hyq) for seed in range(30)]
    nominal = foot_positions(hyq, still.joint_position[None])[0]
    errors = np.array([stacked([s.read(still) for _ in range(10)], "foot_position") for s in runs]) - nominal
    assert errors.mean() == pytest.approx(0.0, abs=3e-3)
    assert errors.std() == pytest.approx(0.02, rel=0.1)
    assert (np.ptp(errors, axis=1).max() < 1e-12) == (drawn == "run")


def test_same_seed_same_errors(hyq: Robot, still: Plant) -> None:
    first, again, other = (Sensors(HARSH, seed, hyq) for seed in (5, 5, 6))
    for _ in range(3):
        a, b, c = first.read(still), again.read(still), other.read(still)
        np.testing.assert_array_equal(a.effort, b.effort)
        np.testing.assert_array_equal(a.specific_force, b.specific_force)
        assert not np.isclose(a.effort, c.effort).all()


def test_harsh_is_twice_standard() -> None:
    for name in ("position", "velocity", "torque", "torque_constant", "gyro", "gyro_constant", "accelerometer"):
        assert getattr(HARSH, name) == pytest.approx(2 * getattr(STANDARD, name))
    assert HARSH.accelerometer_constant == 2 * STANDARD.accelerometer_constant
    assert HARSH.orientation_constant == pytest.approx(2 * STANDARD.orientation_constant)


def test_plant_gets_friction_and_the_estimator_a_guess_of_it(hyq: Robot) -> None:
    truth = plant_model(hyq, HARSH)
    ratios = []
    for seed in range(40):
        believed = estimator_model(truth, HARSH, seed)
        for joint in hyq.tree.joints:
            added = truth.dynamics[joint].coulomb - hyq.dynamics[joint].coulomb
            assert added == pytest.approx(0.006 * hyq.limits[joint].effort)
            ratios.append(believed.dynamics[joint].coulomb / truth.dynamics[joint].coulomb)
    assert np.mean(ratios) == pytest.approx(1.0, abs=0.03)
    assert np.std(ratios) == pytest.approx(0.2, rel=0.1)


def test_estimators_legs_are_wrong_and_physical(hyq: Robot) -> None:
    mass, com = [], []
    for seed in range(40):
        believed = estimator_model(hyq, HARSH, seed)
        assert believed.inertias[hyq.trunk] == hyq.inertias[hyq.trunk]
        for link in hyq.tree.links[1:]:
            assert believed.inertias[link].is_physical() or not hyq.inertias[link].is_physical()
            mass.append(believed.inertias[link].mass / hyq.inertias[link].mass - 1.0)
            com.append(believed.inertias[link].com - hyq.inertias[link].com)
    assert np.std(mass) == pytest.approx(0.05, rel=0.1)
    np.testing.assert_allclose(np.std(com, axis=0), 0.005, rtol=0.1)
    unchanged = estimator_model(hyq, IDEAL, 0)
    for link in hyq.tree.links:
        np.testing.assert_allclose(unchanged.inertias[link].vector, hyq.inertias[link].vector, atol=1e-12)


def test_recordings_get_the_errors_of_joint_sensors(hyq: Robot) -> None:
    time = np.arange(5000) * 1e-3
    joints = hyq.leg("RH").joints
    ramp = np.repeat(time[:, None], 3, axis=1)
    true = Recording(time, joints, ramp, np.ones_like(ramp), np.zeros_like(ramp), ramp)
    got = measured(true, hyq, HARSH, 1)
    assert got.acceleration is None
    assert np.std(got.position - true.position) == pytest.approx(HARSH.position, rel=0.05)
    assert np.std(got.velocity - true.velocity) == pytest.approx(HARSH.velocity, rel=0.05)
    limit = np.array([hyq.limits[joint].effort for joint in joints])
    error = (got.effort - true.effort)[3:]
    np.testing.assert_allclose(error.std(axis=0), HARSH.torque * limit, rtol=0.05)
    late = measured(true, hyq, SensorErrors(torque_delay=0.003), 0)
    np.testing.assert_array_equal(late.effort[3:], true.effort[:-3])
    np.testing.assert_array_equal(measured(true, hyq, IDEAL, 0).effort, true.effort)


def test_imu_frame_of_the_contract(hyq: Robot) -> None:
    assert ImuMount.of(hyq).name == "trunk_imu"
    assert ImuMount.of(replace(hyq, frames={})).name == hyq.trunk
    two = {**hyq.frames, "another_imu": hyq.frames["trunk_imu"]}
    assert ImuMount.of(replace(hyq, frames=two)).name == hyq.trunk


def test_torque_errors_of_a_robot_without_effort_limits_are_those_of_its_weight(hyq: Robot) -> None:
    unlimited = replace(hyq, limits={joint: JointLimits() for joint in hyq.tree.joints})
    friction = [plant_model(unlimited, HARSH).dynamics[joint].coulomb for joint in hyq.tree.joints]
    np.testing.assert_allclose(friction, HARSH.friction * GRAVITY * hyq.mass * hyq.leg_length)
