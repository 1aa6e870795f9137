"""The mass at rest: what is on the robot is found, and what is no rest is refused with the reason."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from stadera.lab.control.stand import TestBed
from stadera.lab.control.trunk import TrunkController
from stadera.lab.laws.equilibrium import ForceNoise, NoisyForces
from stadera.lab.laws.static import MassEstimator, MassSettings
from stadera.lab.plant.payload import RigidMass
from stadera.lab.plant.plant import Plant
from stadera.lab.plant.sensors import IDEAL, STANDARD, SensorErrors, Sensors, measurement_of
from stadera.lab.plant.terrain import Terrain
from stadera.robot import load_robot
from stadera.robot.imu import ImuMount
from stadera.robot.stance import standing_configuration
from stadera.trunk import Measurement, Status, TrunkEstimate, TrunkModel

ROBOT = load_robot("hyq")


@pytest.fixture(scope="module")
def standing() -> Plant:
    """A loaded HyQ at rest on a ramp."""
    plant = Plant(ROBOT, Terrain(slope=np.deg2rad(10.0), heading=0.4))
    plant.reset(standing_configuration(ROBOT))
    plant.apply_payload(RigidMass.box(8.0, (0.2, 0.2, 0.1), (-0.2, 0.1, 0.15)))
    controller = TrunkController(ROBOT, trunk=TrunkModel.of(plant.truth()))
    TestBed(plant, Sensors(IDEAL, 0, ROBOT), controller).run(1.0)
    return plant


def samples(plant: Plant, errors: SensorErrors, seed: int, count: int) -> list[Measurement]:
    """What the sensors say of a plant at rest, over and over."""
    sensors, mount = Sensors(errors, seed, ROBOT), ImuMount.of(ROBOT)
    said = [measurement_of(sensors.read(plant), mount) for _ in range(count)]
    return [replace(m, time=1e-3 * k) for k, m in enumerate(said)]


def fed(estimator: MassEstimator, measurements: list[Measurement]) -> MassEstimator:
    for measurement in measurements:
        estimator.update(measurement)
    return estimator


def test_weighs_a_payload(standing: Plant) -> None:
    estimator = MassEstimator(ROBOT)
    assert estimator.estimate().status is Status.WAITING
    estimate = fed(estimator, samples(standing, IDEAL, 0, 1000)).estimate()
    assert estimate.trunk.mass == pytest.approx(standing.truth().mass, rel=1e-3)
    np.testing.assert_array_equal(estimate.observed, [True, False, False, False])
    np.testing.assert_array_equal(estimate.trunk.com_trunk, ROBOT.inertias[ROBOT.trunk].com)


def test_its_standard_deviation_is_that_of_its_errors(standing: Plant) -> None:
    errors, stds = [], []
    for seed in range(12):
        estimate = fed(MassEstimator(ROBOT), samples(standing, STANDARD, seed, 300)).estimate()
        errors.append(estimate.trunk.mass - standing.truth().mass)
        stds.append(estimate.std[0])
    scaled = np.array(errors) / np.array(stds)
    # χ² of 12 draws: its central 99.8 %
    assert 2.2 < (scaled**2).sum() < 33.0
    assert np.std(stds) < 0.1 * np.mean(stds)


def test_its_standard_deviation_is_what_the_torques_constant_errors_do(standing: Plant) -> None:
    """Each of the twelve moved by itself by its standard deviation; all else that is constant is nil."""
    size, still = 0.5, samples(standing, IDEAL, 0, 200)
    noise = ForceNoise(np.zeros(12), np.full(12, size), foot_position=0.0, leg_mass=0.0)

    def weighed(shift: np.ndarray) -> TrunkEstimate:
        moved = [replace(m, effort=m.effort + shift) for m in still]
        return fed(MassEstimator(ROBOT, forces=NoisyForces(ROBOT, noise)), moved).estimate()

    bare = weighed(np.zeros(12))
    felt = [weighed(size * one).trunk.mass - bare.trunk.mass for one in np.eye(12)]
    assert bare.std[0] == pytest.approx(np.linalg.norm(felt), rel=0.05)


def test_it_settles_and_says_so(standing: Plant) -> None:
    estimator = MassEstimator(ROBOT, settings=MassSettings(time_constant=0.1))
    statuses = []
    for measurement in samples(standing, STANDARD, 1, 600):
        estimator.update(measurement)
        statuses.append(estimator.estimate().status)
    assert statuses[0] is Status.REFUSED  # not seen at rest for long enough yet
    assert statuses[150] is Status.MOVING
    assert statuses[-1] is Status.CONVERGED


def nudged(measurement: Measurement, name: str, index: int, value: float) -> Measurement:
    values = getattr(measurement, name).copy()
    values[index] = value
    return replace(measurement, **{name: values})


def with_two_feet(measurement: Measurement) -> Measurement:
    return replace(measurement, stance=np.array([True, False, False, True]))


def turning(measurement: Measurement) -> Measurement:
    return nudged(measurement, "angular_velocity", 1, 0.3)


def stepping(measurement: Measurement) -> Measurement:
    return nudged(measurement, "joint_velocity", 5, 0.8)


def accelerating(measurement: Measurement) -> Measurement:
    return replace(measurement, specific_force=1.1 * measurement.specific_force)


def saturated(measurement: Measurement) -> Measurement:
    return nudged(measurement, "effort", 4, 150.0)


def slipping(measurement: Measurement) -> Measurement:
    return nudged(measurement, "joint_position", 4, measurement.joint_position[4] + 0.06)


@pytest.mark.parametrize(
    ("spoil", "reason"),
    [
        (with_two_feet, "only 2 feet carry (LF, RH), 3 are needed"),
        (turning, "the trunk turns"),
        (stepping, "joint 'rf_kfe_joint' moves"),
        (accelerating, "specific force changes by +0.26 m/s²"),
        (saturated, "the torque of joint 'rf_hfe_joint' is at its limit"),
        (slipping, "foot RF slipped by"),
    ],
)
def test_refuses_and_says_why(standing: Plant, spoil: Callable[[Measurement], Measurement], reason: str) -> None:
    good = samples(standing, IDEAL, 0, 900)
    estimator = fed(MassEstimator(ROBOT), good[:300])
    before, said = estimator.estimate(), []
    for measurement in good[300:600]:
        estimator.update(spoil(measurement))
        after = estimator.estimate()
        if after.status is Status.REFUSED:
            said.append((after.reason, after.trunk.mass))
    assert reason in said[0][0]
    # a motion is noticed within some milliseconds, and from then on the last good estimate is kept
    assert said[0][1] == pytest.approx(before.trunk.mass, rel=1e-3)
    assert len({mass for _, mass in said[:100]}) == 1
    fed(estimator, good[600:])
    again = estimator.estimate()
    assert again.status in (Status.MOVING, Status.CONVERGED)
    assert again.trunk.mass == pytest.approx(before.trunk.mass, rel=1e-6)


def test_a_mass_that_cannot_be_is_refused(standing: Plant) -> None:
    measurements = [replace(m, effort=3.2 * m.effort) for m in samples(standing, IDEAL, 0, 300)]
    limits = {joint: replace(limit, effort=np.inf) for joint, limit in ROBOT.limits.items()}
    estimator = MassEstimator(replace(ROBOT, limits=limits))
    estimate = fed(estimator, measurements).estimate()
    assert estimate.status is Status.REFUSED
    assert "runs away: trunk mass" in estimate.reason
    assert estimate.trunk.mass == ROBOT.inertias[ROBOT.trunk].mass
