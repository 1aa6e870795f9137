"""Legs in the air: trajectories, torques and touch-down; and one leg lifted and put down by measurements alone."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lab.control.testbed import ROBOTS, bed, robot_named
from stadera.lab.control.legs import LegDynamics
from stadera.lab.control.reference import Move, TrunkPose
from stadera.lab.control.stand import TestBed
from stadera.lab.control.swing import SwingTrajectory
from stadera.lab.control.trunk import TrunkController
from stadera.lab.pinocchio import pinocchio_model
from stadera.lab.plant.sensors import HARSH, STANDARD
from stadera.robot.kinematics import foot_positions
from stadera.robot.stance import standing_configuration

LEG = 1


def over_the_others(test: TestBed, leg: int) -> np.ndarray:
    """From the believed centre of mass to the middle of the other feet, level."""
    c, measurement = test.controller, test.measurement
    assert isinstance(c, TrunkController)
    assert measurement is not None
    com = (c.trunk.moment + c.legs.measured(measurement).moment) / (c.trunk.mass + c.legs.leg_mass)
    shift = np.delete(c.feet, leg, axis=0).mean(axis=0) - c.position - c.rotation @ com
    return np.array([shift[0], shift[1], 0.0])


@pytest.mark.parametrize(("name", "errors"), [("hyq", STANDARD), ("go2", HARSH), ("anymal_c", HARSH)])
def test_a_leg_is_lifted_and_put_down(name: str, errors: object) -> None:
    robot = robot_named(name)
    test = bed(robot, errors=errors)  # type: ignore[arg-type]
    c = test.controller
    assert isinstance(c, TrunkController)
    test.run(0.2)
    c.move(c.reference.moved(0.8 * over_the_others(test, LEG), np.zeros(3)), 0.6)
    test.run(0.7)
    c.relieve(LEG, 0.1)
    test.run(0.11)
    assert c.relieved.tolist() == [False, True, False, False]
    before, weight = test.plant.state, robot.mass * 9.81
    assert np.linalg.norm(before.foot_force[LEG]) < 0.02 * weight
    height = 0.1 * float(c.position[2] - c.feet[LEG, 2])
    c.swing(LEG, SwingTrajectory(c.feet[LEG], c.feet[LEG] + np.array([0.05, 0.0, 0.0]), c.time, 0.4, max(height, 0.05)))
    highest, early, contacts = 0.0, 0, []
    for k in range(700):
        test.step()
        foot = test.plant.state.foot_position[LEG]
        highest = max(highest, float(foot[2] - before.foot_position[LEG, 2]))
        early += k < 300 and bool(c.swinging.touched[LEG])
        contacts.append(bool(test.plant.state.foot_contact[LEG]))
        if k >= 300 and c.swinging.touched[LEG]:
            break
    assert early == 0
    assert any(contacts[-10:])
    assert highest > 0.045
    assert np.abs(foot - before.foot_position[LEG] - [0.05, 0.0, 0.0]).max() < 0.006
    c.land(LEG, 0.1)
    test.run(0.4)
    after = test.plant.state
    assert after.foot_force[LEG, 2] > 0.05 * weight
    np.testing.assert_allclose(c.position - after.position, before_offset(before, after, c), atol=0.003)
    assert np.abs(after.linear_velocity).max() < 0.03


def before_offset(before: object, after: object, c: TrunkController) -> np.ndarray:
    """Where the odometry's origin is: the nominal height above the ground, as the run began over the world's origin."""
    height = -foot_positions(c.robot, standing_configuration(c.robot)[None])[0, :, 2].mean()
    return np.array([0.0, 0.0, -(height + c.robot.legs[0].foot_radius)])


@settings(max_examples=30, deadline=None)
@given(st.floats(0.2, 1.0), st.floats(0.0, 0.2), st.floats(-0.1, 0.1), st.floats(0.0, 0.3))
def test_trajectories_are_smooth(duration: float, clearance: float, up: float, descent: float) -> None:
    start, target = np.array([0.1, 0.2, -0.5]), np.array([0.3, 0.15, -0.5 + up])
    path = SwingTrajectory(start, target, 1.0, duration, clearance, descent=descent)
    for time, place in ((1.0, start), (1.0 + duration, target)):
        p, v, a = path.at(time)
        np.testing.assert_allclose(p, place, atol=1e-12)
        np.testing.assert_allclose(v, 0.0, atol=1e-12)
    dt = 1e-5
    for time in np.linspace(1.0 + 2 * dt, 1.3 + 1.5 * duration, 23):
        (p0, v0, _), (_, v, a), (p1, v1, _) = (path.at(time + k * dt) for k in (-1, 0, 1))
        np.testing.assert_allclose((p1 - p0) / (2 * dt), v, atol=2e-3)
        if abs(time - path.end) > dt:  # where the foot begins to search for the ground
            np.testing.assert_allclose((v1 - v0) / (2 * dt), a, atol=0.3)
    highest = max(float(path.at(1.0 + x * duration)[0][2]) for x in np.linspace(0, 1, 101))
    assert highest >= max(start[2], target[2]) + 0.99 * clearance - 1e-9


@pytest.mark.parametrize("name", ROBOTS)
def test_motion_of_legs_by_finite_differences(name: str) -> None:
    """Feet of a trunk that turns about its origin, at constant joint rates; and the mass matrix by kinetic energy."""
    robot, rng = robot_named(name), np.random.default_rng(3)
    q, qd = standing_configuration(robot), rng.normal(0, 2, 12)
    omega, force = rng.normal(0, 1, 3), rng.normal(0, 5, 3)
    legs = LegDynamics(robot)
    state = legs.at(q, qd, omega, force)
    motion = legs.motion()

    def feet(t: float) -> np.ndarray:
        return foot_positions(robot, (q + t * qd)[None])[0] @ pin.exp3(t * omega).T

    dt = 1e-4
    np.testing.assert_allclose(motion.velocity, (feet(dt) - feet(-dt)) / (2 * dt), atol=1e-5)
    second = (feet(dt) - 2 * feet(0.0) + feet(-dt)) / dt**2
    np.testing.assert_allclose(motion.free_acceleration - force, second, atol=1e-4)
    model = pinocchio_model(robot)
    model.gravity = pin.Motion.Zero()
    data, acceleration = model.createData(), np.zeros(18)
    leg = 2
    acceleration[6 + legs.columns[leg]] = rng.normal(0, 3, 3)
    neutral = np.r_[np.zeros(6), 1.0, q]
    inertial = pin.rnea(model, data, neutral, np.zeros(18), acceleration)  # rotors included
    joint = acceleration[6 + legs.columns[leg]]
    np.testing.assert_allclose(motion.inertia[leg] @ joint, inertial[6 + legs.columns[leg]], atol=1e-9)
    np.testing.assert_allclose(motion.coupling[leg] @ joint, inertial[:6], atol=1e-9)
    assert state.bias.shape == (4, 3)


def test_a_move_between_moving_poses() -> None:
    turned = pin.exp3(np.array([0.1, -0.2, 0.5]))
    start = TrunkPose(np.zeros(3), np.eye(3), np.array([0.2, 0.0, 0.0]), np.array([0.0, 0.1, 0.3]))
    goal = TrunkPose(np.array([0.3, 0.1, 0.0]), turned, np.array([0.1, 0.1, 0.0]), np.array([0.05, 0.0, -0.2]))
    move, dt = Move(start, goal, 2.0, 1.5), 1e-6
    for time, pose in ((2.0, start), (3.5 - 1e-12, goal), (3.5, goal)):
        there = move.at(time)
        for what in ("position", "rotation", "velocity", "angular_velocity"):
            np.testing.assert_allclose(getattr(there, what), getattr(pose, what), atol=1e-8)
    for time in (2.3, 2.9, 3.4, 3.7):
        a, b, c = (move.at(time + k * dt) for k in (-1, 0, 1))
        np.testing.assert_allclose((c.position - a.position) / (2 * dt), b.velocity, atol=1e-7)
        np.testing.assert_allclose((c.velocity - a.velocity) / (2 * dt), b.acceleration, atol=1e-6)
        np.testing.assert_allclose(pin.log3(a.rotation.T @ c.rotation) / (2 * dt), b.angular_velocity, atol=1e-7)
