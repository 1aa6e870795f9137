"""The vertical without an IMU: against Pinocchio's standing robot, its sensitivities against differences and draws."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from stadera.inertia import InertialParameters
from stadera.lab.laws.equilibrium import NoisyForces, equilibrium_rows, weight_felt
from stadera.lab.laws.poses import PoseMean, centre_of, plausible, with_poses
from stadera.lab.laws.recursive import ContactCom
from stadera.lab.laws.static import felt_by_mass, stated_errors
from stadera.logs import Recording
from stadera.robot import Robot, load_robot
from stadera.robot.stance import standing_configuration
from stadera.trunk import Measurement, Status
from stadera.trunk.model import TrunkBounds, TrunkModel
from stadera.trunk.standing.forces import measurements_without_imu, vertical_by_forces
from standing import GRAVITY, StandingRobot

HYQ = load_robot("hyq")
STANCE = standing_configuration(HYQ)
LOAD, PLACE = 8.0, (-0.2, 0.1, 0.1)
PLANT = StandingRobot(HYQ, LOAD, PLACE)
FORCES = NoisyForces(HYQ)
ERROR_STD = stated_errors(HYQ, FORCES.noise)
LIMIT = np.array([HYQ.limits[joint].effort for joint in HYQ.tree.joints])
JOINTS = np.array([HYQ.tree.joints.index(joint) for leg in HYQ.legs for joint in leg.joints])
TILTS = ((0, 0), (8, 0), (-8, 0), (0, 8), (0, -8), (6, 6))


def turned(roll: float, pitch: float) -> np.ndarray:
    return Rotation.from_euler("xy", [roll, pitch], degrees=True).as_matrix()


def blind(exact: Measurement) -> Measurement:
    """The same robot without its IMU."""
    up, _ = vertical_by_forces(HYQ, exact.joint_position[None], exact.joint_velocity[None], exact.effort[None])
    return replace(exact, specific_force=GRAVITY * up[0], rotation=None, vertical_by_forces=True)


def found(effort: np.ndarray, robot: Robot = HYQ) -> tuple[np.ndarray, float]:
    up, mass = vertical_by_forces(robot, STANCE[None], np.zeros((1, 12)), effort[None])
    return up[0], float(mass[0])


@settings(max_examples=30, deadline=None)
@given(roll=st.floats(-9, 9), pitch=st.floats(-9, 9))
def test_however_the_trunk_is_tilted_vertical_and_mass_are_exact(roll: float, pitch: float) -> None:
    R = turned(roll, pitch)
    up, mass = found(PLANT.efforts(STANCE, R))
    np.testing.assert_allclose(up, R[2], atol=1e-9)
    assert mass == pytest.approx(PLANT.mass, rel=1e-9)


def test_of_three_feet_and_of_another_robot() -> None:
    R = turned(2, -1)
    leaning = StandingRobot(HYQ, 20.0, (0.3, 0.2, 0.1))
    up, mass = found(leaning.efforts(STANCE, R, carrying=(0, 1, 2)))  # RH is in the air
    np.testing.assert_allclose(up, R[2], atol=1e-9)
    assert mass == pytest.approx(leaning.mass, rel=1e-9)
    go2 = load_robot("go2")
    q, plant = standing_configuration(go2), StandingRobot(go2, 3.0, (0.05, 0.0, 0.1))
    up, weighs = (x[0] for x in vertical_by_forces(go2, q[None], 0 * q[None], plant.efforts(q, R)[None]))
    np.testing.assert_allclose(up, R[2], atol=1e-9)
    assert weighs == pytest.approx(plant.mass, rel=1e-9)


def test_what_errors_do_is_what_differences_say() -> None:
    exact = PLANT.measurement(0.0, STANCE, turned(4, -3))
    m = blind(exact)
    felt = weight_felt(FORCES.at(m), HYQ, m.up)
    np.testing.assert_allclose(felt_by_mass(FORCES.at(m), m, HYQ), felt[0])
    up, mass = found(exact.effort)
    for k, joint in enumerate(JOINTS):
        effort = exact.effort.copy()
        effort[joint] += 1e-3
        tilted, heavier = found(effort)
        np.testing.assert_allclose(felt[1:, k], (tilted - up) / 1e-3, atol=1e-7)
        assert felt[0, k] == pytest.approx((heavier - mass) / 1e-3, abs=1e-5)
    links = HYQ.tree.links[1:]
    for k in (0, 4, 11):
        body = HYQ.inertias[links[k]]
        believed = replace(HYQ, inertias={**HYQ.inertias, links[k]: InertialParameters(1.001 * body.vector)})
        tilted, heavier = found(exact.effort, believed)
        np.testing.assert_allclose(felt[1:, 27 + k], (tilted - up) / 1e-3, atol=1e-5)
        trunk = heavier - 1e-3 * body.mass - mass
        assert felt[0, 27 + k] == pytest.approx(trunk / 1e-3, abs=1e-3)
    assert not felt[:, 24:27].any()


def test_tilted_poses_show_the_height() -> None:
    poses = [PoseMean(blind(PLANT.measurement(0.0, STANCE, turned(*tilt)))) for tilt in TILTS]
    mass, com, covariance = solved(poses)
    np.testing.assert_allclose(com, PLANT.trunk_com, atol=1e-4)
    assert mass == pytest.approx(PLANT.trunk_mass, rel=1e-4)
    level = solved(poses[:1])[2]
    assert np.sqrt(level[3, 3]) > 10 * np.sqrt(covariance[3, 3]), "one pose shows no height"


def solved(poses: list[PoseMean]) -> tuple[float, np.ndarray, np.ndarray]:
    """Mass, centre of mass and covariance by approach (a)."""
    for p in poses:
        _, target = equilibrium_rows(FORCES, p.measurement, p.count, np.zeros(39), 0.0, p.effort_covariance)
        assert len(target) == 4
    known = with_poses(plausible(HYQ, TrunkModel.prior(HYQ), TrunkBounds.of(HYQ)), FORCES, poses)
    value, covariance = centre_of(known.consider(np.diag(ERROR_STD), ("errors",)))
    return float(value[0]), value[1:], covariance


def test_errors_of_the_trunk_and_of_the_vertical_are_as_large_as_stated() -> None:
    squares = []
    for seed in range(10):
        rng = np.random.default_rng(seed)
        offset = 0.0033 * LIMIT * rng.standard_normal(12)
        poses = []
        for tilt in TILTS:
            exact = blind(PLANT.measurement(0.0, STANCE, turned(*tilt)))
            efforts = exact.effort + offset + 0.0033 * LIMIT * rng.standard_normal((60, 12))
            poses.append(PoseMean(replace(exact, effort=efforts[0])))
            for effort in efforts[1:]:
                assert poses[-1].takes(replace(exact, effort=effort))
        mass, com, covariance = solved(poses)
        off = np.array([mass - PLANT.trunk_mass, *(com - PLANT.trunk_com)]) / np.sqrt(np.diag(covariance))
        m = blind(poses[0].measurement)
        felt = weight_felt(FORCES.at(m), HYQ, m.up)[1:3]
        std = np.sqrt(np.diag((felt * ERROR_STD**2) @ felt.T))
        squares.append([*off**2, *((m.up - turned(*TILTS[0])[2])[:2] / std) ** 2])
    total = np.sum(
        squares, axis=0
    )  # χ² of 10 draws, its central 99.8 %; links' masses, right here, are in the bars too
    assert (total < 29.6).all()
    assert (total > 0.5).all()


def test_a_log_becomes_measurements() -> None:
    R = turned(3, 2)
    time, effort = np.arange(3) / 100.0, np.tile(PLANT.efforts(STANCE, R), (3, 1))
    log = Recording(time, HYQ.tree.joints, np.tile(STANCE, (3, 1)), np.zeros((3, 12)), effort=effort)
    first, *others = measurements_without_imu(log, HYQ)
    assert len(others) == 2
    assert first.vertical_by_forces
    np.testing.assert_allclose(first.specific_force, GRAVITY * R[2], atol=1e-8)
    assert not first.angular_velocity.any()


def test_estimators_that_take_the_vertical_for_granted_refuse() -> None:
    estimator = ContactCom(HYQ)
    estimator.update(blind(PLANT.measurement(0.0, STANCE)))
    estimate = estimator.estimate()
    assert estimate.status is Status.REFUSED
    assert "needs an IMU" in estimate.reason


def test_a_robot_that_hangs_or_has_no_torques_is_not_taken_for_standing() -> None:
    up, mass = found(PLANT.holding(STANCE, np.eye(3)))
    assert np.isfinite(up).all()
    assert mass < 0.2 * PLANT.mass
    up, _ = found(np.zeros(12))
    assert np.linalg.norm(up) == pytest.approx(1.0)
