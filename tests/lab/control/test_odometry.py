"""Leg odometry from feet that stand still in the world."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from stadera.lab.control.stand import TestBed
from stadera.lab.control.trunk import LegOdometry, TrunkController
from stadera.lab.plant.plant import Plant
from stadera.lab.plant.sensors import IDEAL, Sensors
from stadera.robot import load_robot
from stadera.robot.kinematics import foot_positions
from stadera.robot.stance import standing_configuration
from standing import foot_jacobians

ALL = np.ones(4, dtype=bool)
FEET = np.array([[0.4, 0.2, -0.6], [0.4, -0.2, -0.6], [-0.4, 0.2, -0.6], [-0.4, -0.2, -0.6]])


def levers(position: np.ndarray, grounded: np.ndarray) -> np.ndarray:
    """Feet from the trunk's origin, world axes, of feet that stand at `grounded`."""
    return grounded - position


def test_follows_the_trunk() -> None:
    odometry, rng = LegOdometry(), np.random.default_rng(0)
    odometry.locate(FEET, ALL)
    np.testing.assert_array_equal(odometry.position, 0.0)
    for _ in range(20):
        position = rng.normal(0.0, 0.02, 3)
        odometry.locate(levers(position, FEET), ALL)
        np.testing.assert_allclose(odometry.position, position, atol=1e-12)
    np.testing.assert_array_equal(odometry.anchors, FEET)


def test_goes_on_over_steps() -> None:
    odometry, grounded, position = LegOdometry(), FEET.copy(), np.zeros(3)
    odometry.locate(FEET, ALL)
    for foot in (0, 3, 1, 2):
        three = np.arange(4) != foot
        for _ in range(5):
            position = position + np.array([0.004, 0.001, 0.0])
            odometry.locate(levers(position, grounded), three)
            np.testing.assert_allclose(odometry.position, position, atol=1e-12)
        grounded[foot] += [0.05, 0.01, 0.02]
        four = np.ones(4, dtype=bool)
        odometry.locate(levers(position, grounded), four)
        np.testing.assert_allclose(odometry.position, position, atol=1e-12)
        np.testing.assert_allclose(odometry.anchors, grounded, atol=1e-12)


def test_a_foot_that_slips_is_anchored_anew() -> None:
    odometry, grounded = LegOdometry(), FEET.copy()
    odometry.locate(FEET, ALL)
    grounded[2] += [0.03, 0.0, 0.0]
    odometry.locate(grounded, ALL)
    left = odometry.anchors - grounded - odometry.position
    np.testing.assert_allclose(left[2], 0.0, atol=1e-12)
    np.testing.assert_allclose(left[[0, 1, 3], 0], 0.0075, atol=1e-12)


def test_in_the_air_it_stays() -> None:
    odometry = LegOdometry()
    odometry.locate(FEET, ALL)
    odometry.locate(FEET - [0.01, 0.0, 0.0], ALL)
    odometry.locate(FEET + 5.0, np.zeros(4, dtype=bool))
    np.testing.assert_allclose(odometry.position, [0.01, 0.0, 0.0], atol=1e-12)


def test_velocity_by_finite_differences() -> None:
    """A trunk that moves over fixed feet: joints by inverse kinematics of small steps, v by differences."""
    robot = load_robot("hyq")
    rng = np.random.default_rng(1)
    R = Rotation.from_rotvec([0.1, -0.2, 0.3])
    q = standing_configuration(robot)
    feet, J = foot_positions(robot, q[None])[0], foot_jacobians(robot, q[None])[0]
    linear, omega, point = *rng.normal(0.0, 1.0, (2, 3)), rng.normal(0.0, 0.2, 3)  # trunk axes
    columns = [[robot.tree.joints.index(joint) for joint in leg.joints] for leg in robot.legs]
    # a foot at rest: 0 = v + ω x p + J q̇
    rates = np.array([np.linalg.solve(J[k], -linear - np.cross(omega, feet[k])) for k in range(4)])
    odometry, dt = LegOdometry(), 1e-6
    odometry.locate(feet @ R.as_matrix().T, ALL)
    found = odometry.velocity(feet - point, (J @ rates[:, :, None])[:, :, 0], omega)
    np.testing.assert_allclose(found, linear + np.cross(omega, point), atol=1e-12)
    later = q.copy()
    later[columns] += dt * rates
    turned = R * Rotation.from_rotvec(dt * omega)
    odometry.locate(foot_positions(robot, later[None])[0] @ turned.as_matrix().T, ALL)
    np.testing.assert_allclose(odometry.position / dt, R.as_matrix() @ linear, atol=1e-5)


def test_rolling_feet_do_not_move_the_trunk() -> None:
    """HyQ's feet are spheres of 2 cm: swaying over them by 10 cm rolls them by 3 mm, which is not the trunk's way."""
    robot = load_robot("hyq")
    plant = Plant(robot)
    plant.reset(standing_configuration(robot))
    controller = TrunkController(robot)
    bed = TestBed(plant, Sensors(IDEAL, 0, robot), controller)
    bed.run(0.1)
    before, began = plant.state, controller.position
    controller.move(controller.reference.moved(np.array([0.08, 0.06, -0.04]), np.zeros(3)), 0.5)
    bed.run(0.7)
    gone = plant.state.position - before.position
    rolled = np.linalg.norm(plant.state.foot_position - before.foot_position, axis=1)
    assert rolled.min() > 2e-3
    np.testing.assert_allclose(controller.position - began, gone, atol=3e-4)


def test_velocity_by_legs_and_imu() -> None:
    """The legs' noise is smoothed, the accelerometer's offset a fades to a T, and in the air the IMU goes on alone."""
    odometry, rng, dt, offset = LegOdometry(0.05), np.random.default_rng(2), 1e-3, 0.1
    odometry.locate(FEET, ALL)
    truth, found = np.zeros(3), []
    for k in range(2000):
        acceleration = np.array([np.cos(5e-3 * k), 0.0, 0.0])
        truth = truth + dt * acceleration
        by_legs = truth + rng.normal(0.0, 0.02, 3)
        found.append(odometry.fused(by_legs, acceleration + offset, dt) - truth)
    late = np.array(found[500:])
    np.testing.assert_allclose(late.mean(axis=0), offset * 0.05, atol=2e-3)
    assert late.std(axis=0).max() < 0.02 * np.sqrt(dt / 0.05)
    odometry.locate(FEET, np.zeros(4, dtype=bool))
    before = odometry.fused(np.full(3, 9.0), np.zeros(3), dt)
    np.testing.assert_allclose(odometry.fused(np.full(3, 9.0), np.ones(3), dt), before + dt, atol=1e-12)
