"""Standing robots: they stay where they are, tilt under a wrong belief as eq. 12 says, and take a new one smoothly."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import fsolve
from scipy.spatial.transform import Rotation

from lab.control.testbed import ROBOTS, bed, load_of, moved, robot_named
from stadera.lab.control.reference import TrunkPose
from stadera.lab.control.trunk import TrunkGains, composite
from stadera.lab.laws.equilibrium import NoisyForces
from stadera.lab.laws.static import MassEstimator, MassSettings
from stadera.lab.plant.payload import VirtualForce
from stadera.lab.plant.sensors import STANDARD
from stadera.lab.plant.terrain import Terrain
from stadera.robot.stance import standing_configuration
from stadera.trunk import TrunkModel

STAND_CASES = [(0.0, 0.0), (10.0, 0.06), (15.0, 0.12)]
WRONG_SHARES = [(0.4, -0.3), (-0.3, 0.4)]


@pytest.mark.parametrize("name", ROBOTS)
@pytest.mark.parametrize(("degrees", "share"), STAND_CASES)
def test_stands_where_it_is(name: str, degrees: float, share: float) -> None:
    robot = robot_named(name)
    terrain = Terrain(slope=np.deg2rad(degrees), heading=0.5)
    test = bed(robot, terrain=terrain, payload=load_of(robot, share) if share else None)
    start = test.plant.state
    test.run(1.0)
    distance, angle = moved(start, test.plant.state)
    assert distance < 0.002
    assert np.rad2deg(angle) < 0.1
    assert test.plant.state.foot_contact.all()
    assert not test.controller.saturated.any()
    np.testing.assert_allclose(
        test.controller.odometry.position, test.plant.state.position - start.position, atol=0.001
    )


@pytest.mark.parametrize("name", ROBOTS)
def test_stands_with_real_sensors_and_an_unknown_load(name: str) -> None:
    robot = robot_named(name)
    prior = TrunkModel.prior(robot)
    test = bed(robot, payload=load_of(robot, 0.06), errors=STANDARD, trunk=lambda _: prior)
    start = test.plant.state
    test.run(1.0)
    distance, angle = moved(start, test.plant.state)
    assert distance < 0.01
    assert np.rad2deg(angle) < 2.5  # the load tilts it, as eq. 12 says
    assert np.abs(test.plant.state.joint_velocity).max() < 0.02


@pytest.mark.parametrize("name", ROBOTS)
@pytest.mark.parametrize("wrong", WRONG_SHARES)
def test_tilts_as_the_closed_form_says(name: str, wrong: tuple[float, float]) -> None:
    """K_a log(Rᵀ R_d) = δ x m g Rᵀ e_z, solved for R, with everything on the right of it the plant's truth."""
    robot = robot_named(name)
    offset = np.array([*wrong, 0.3]) * np.abs(robot.tree.translations[:, :2]).max() * 0.5
    test = bed(robot, trunk=lambda truth: TrunkModel(truth.mass, truth.com_trunk + offset))
    test.run(2.0)
    state, stiffness = test.plant.state, test.controller.gains.angular_stiffness
    trunk = robot.inertias[robot.trunk].mass
    delta, weight = -offset * trunk / robot.mass, robot.mass * 9.81

    def unbalanced(turn: np.ndarray) -> np.ndarray:
        rotation = Rotation.from_rotvec(turn).as_matrix()
        return stiffness * -turn - np.cross(delta, weight * rotation[2])

    expected = fsolve(unbalanced, np.zeros(3), xtol=1e-12)
    found = Rotation.from_matrix(state.rotation).as_rotvec()
    assert np.linalg.norm(expected[:2]) > np.deg2rad(0.5)
    np.testing.assert_allclose(found, expected, atol=1e-4 * np.linalg.norm(expected))
    # small angles, eq. 12: c - ĉ = (K_y θ, -K_x φ) / m g
    roll, pitch = found[:2]
    small = np.array([stiffness[1] * pitch, -stiffness[0] * roll]) / weight
    np.testing.assert_allclose(small, delta[:2], atol=0.1 * np.linalg.norm(delta))


def test_stands_the_papers_load_with_a_trunk_far_off() -> None:
    robot = robot_named("hyq")
    off = np.array([0.2, -0.16, 0.0])
    test = bed(
        robot,
        payload=VirtualForce(100.0, (-0.75, 0.4, 0.0)),
        trunk=lambda truth: TrunkModel(truth.mass, truth.com_trunk + off),
    )
    test.run(1.5)
    assert test.plant.state.foot_contact.all()
    assert np.abs(test.plant.state.joint_velocity).max() < 0.01


def largest_step(trunk_time: float) -> float:
    """Largest change of a joint's torque in one period [N·m], while a standing robot gets the right belief."""
    robot = robot_named("hyq")
    off = np.array([0.1, -0.06, 0.05])
    wrong = TrunkModel(0.8 * robot.inertias[robot.trunk].mass, TrunkModel.prior(robot).com_trunk + off)
    test = bed(robot, trunk=lambda _: wrong)
    test.controller.trunk.time_constant = trunk_time
    test.run(1.0)
    efforts = [test.plant.effort]
    truth = TrunkModel.of(test.plant.truth())
    assert test.controller.update_trunk(truth)
    test.run(0.5, lambda test: efforts.append(test.plant.effort))
    np.testing.assert_allclose(test.controller.trunk.model.com_trunk, truth.com_trunk, atol=1e-4)
    return float(np.abs(np.diff(efforts, axis=0)).max())


def test_a_new_trunk_changes_torques_smoothly() -> None:
    at_once, smooth = largest_step(1e-9), largest_step(0.05)
    assert at_once > 10.0
    assert smooth < 0.025 * at_once  # dt / T = 2 % in the first step, less in all others


def test_moves_to_another_pose() -> None:
    robot = robot_named("go2")
    test = bed(robot)
    test.run(0.3)
    start = test.plant.state
    goal = test.controller.reference.moved(np.array([0.01, -0.02, -0.03]), np.deg2rad([3.0, 6.0, -4.0]))
    test.controller.move(goal, 1.0)
    test.run(2.0)
    end = test.plant.state
    np.testing.assert_allclose(end.position - start.position, [0.01, -0.02, -0.03], atol=0.002)
    np.testing.assert_allclose(start.rotation.T @ end.rotation, goal.rotation, atol=0.003)
    assert isinstance(test.controller.reference, TrunkPose)


@pytest.mark.parametrize("name", ROBOTS)
def test_forces_from_torques_are_the_plants(name: str) -> None:
    """The estimator against the truth of MuJoCo, on a ramp, loaded, sensors ideal."""
    robot = robot_named(name)
    test = bed(robot, terrain=Terrain(slope=np.deg2rad(12.0), heading=1.0), payload=load_of(robot, 0.12))
    test.run(1.0)
    test.step()
    estimator = NoisyForces(robot)
    measurement, truth = test.measurement, test.plant.state
    assert measurement is not None
    found = estimator.at(measurement)
    np.testing.assert_array_equal(found.stance, truth.foot_contact)
    weight = robot.mass * 9.81
    np.testing.assert_allclose(found.force @ truth.rotation.T, truth.foot_force, atol=1e-3 * weight)
    np.testing.assert_allclose(truth.position + found.contact @ truth.rotation.T, truth.contact_point, atol=1e-3)
    # the forces asked for are the forces that there are
    np.testing.assert_allclose(test.controller.forces, truth.foot_force, atol=2e-3 * weight)


def test_gains_scale_with_the_robot() -> None:
    for name in ("hyq", "go2"):
        robot = robot_named(name)
        gains = TrunkGains.of(robot)
        whole = composite(robot, standing_configuration(robot))
        np.testing.assert_allclose(gains.stiffness / whole.mass, 12.0**2)
        np.testing.assert_allclose(gains.angular_stiffness / np.diag(whole.inertia_com), 16.0**2)


def test_an_estimator_is_fed_and_heard() -> None:
    robot = robot_named("hyq")
    prior = TrunkModel.prior(robot)
    test = bed(
        robot,
        payload=load_of(robot, 0.06),
        trunk=lambda _: prior,
        estimator=lambda controller: MassEstimator(
            robot, forces=NoisyForces(robot), settings=MassSettings(time_constant=0.1)
        ),
        feed_back=True,
        every=4,
    )
    test.run(1.5)
    assert test.controller.trunk.mass == pytest.approx(test.plant.truth().mass, rel=2e-3)
    start = test.plant.state
    test.run(0.2)
    assert moved(start, test.plant.state)[0] < 1e-3
