"""Static poses: their equations against finite differences, what they show, and errors told apart from the load."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from stadera.inertia import InertialParameters
from stadera.lab.laws.equilibrium import NoisyForces, constant_errors_of, equilibrium_rows, error_slope, wrench_slope
from stadera.lab.laws.poses import COMBINED, PosesCom
from stadera.lab.laws.static_poses import PoseOffset, standing_still, static_poses
from stadera.robot import Robot, load_robot
from stadera.robot.kinematics import foot_positions
from stadera.trunk import Measurement
from standing import GRAVITY, StandingRobot

ROBOT = load_robot("hyq")
TRUTH = StandingRobot(ROBOT, 10.0, (-0.3, 0.15, 0.1))
POSES = static_poses(ROBOT)
PLACES = constant_errors_of(ROBOT)
ERRORS = len(PLACES)


def held(pose: PoseOffset) -> Measurement:
    still = standing_still(ROBOT, pose)  # joint angles and rotation; the torques are Pinocchio's
    assert still is not None
    return TRUTH.measurement(0.0, still.joint_position, still.rotation)


def fed(
    estimator: PosesCom, poses: tuple[PoseOffset, ...], torque: np.ndarray | float = 0.0, feet: object = None
) -> PosesCom:
    time = 0.0
    for pose in poses:
        m = held(pose)
        places = None if feet is None else foot_positions(ROBOT, m.joint_position[None])[0] + feet
        for _ in range(80):
            time += 0.01
            estimator.update(replace(m, time=time, effort=m.effort + torque, foot_position=places))
    return estimator


def test_the_truth_solves_the_equations() -> None:
    forces = NoisyForces(ROBOT)
    theta = np.array([TRUTH.trunk_mass, *(TRUTH.trunk_mass * TRUTH.trunk_com), *np.zeros(ERRORS)])
    for pose in POSES:
        matrix, target = equilibrium_rows(forces, held(pose), 1.0, np.zeros(ERRORS))
        np.testing.assert_allclose(matrix @ theta, target, atol=1e-6)


def test_wrench_slopes_are_finite_differences() -> None:
    source, m = NoisyForces(ROBOT), held(POSES[3])
    feet = foot_positions(ROBOT, m.joint_position[None])[0]
    m = replace(m, foot_position=feet)
    slope, columns = wrench_slope(source.at(m)), source.body.in_legs.reshape(4, 3)
    for leg in range(4):
        for k in range(3):
            push = np.zeros(12)
            push[columns[leg, k]] = 1e-4
            by_torque = (source.at(replace(m, effort=m.effort + push)).wrench - source.at(m).wrench) / 1e-4
            np.testing.assert_allclose(slope[:, 3 * leg + k], by_torque, rtol=1e-5, atol=1e-5)
            # the normal of the ground turns with the feet: by so little, times a foot's radius, that it is left out
            shifted = feet.copy()
            shifted[leg, k] += 1e-6
            by_foot = (source.at(replace(m, foot_position=shifted)).wrench - source.at(m).wrench) / 1e-6
            np.testing.assert_allclose(slope[:, 12 + 3 * leg + k], by_foot, atol=0.05 * TRUTH.mass * GRAVITY)


def test_slopes_of_the_legs_masses_are_finite_differences() -> None:
    """A link believed heavier, by a robot of its own; only what the trunk is told by is compared."""
    m, share = held(POSES[3]), 1e-4
    assert m.rotation is not None

    def told(robot: Robot) -> np.ndarray:
        source = NoisyForces(robot)
        forces = source.at(m)
        held_up = np.concatenate([source.leg_mass * m.up, np.cross(forces.weights.moment, m.up)]) * GRAVITY
        return forces.wrench - held_up

    slope = error_slope(NoisyForces(ROBOT).at(m), ROBOT, m.up)[:, PLACES["link_mass"]]
    before = told(ROBOT)
    for k, link in enumerate(ROBOT.tree.links[1:]):
        heavier = InertialParameters((1.0 + share) * ROBOT.inertias[link].vector)
        after = told(replace(ROBOT, inertias={**ROBOT.inertias, link: heavier}))
        np.testing.assert_allclose(slope[:, k], (after - before) / share, rtol=1e-4, atol=1e-4)


def test_rows_know_the_errors_that_made_them() -> None:
    """Rows made linear at the errors that are there have the truth as their solution."""
    rng = np.random.default_rng(3)
    torque, feet, turn = rng.normal(0, 5, 12), rng.normal(0, 0.02, (4, 3)), rng.normal(0, 0.005, 3)
    source, m = NoisyForces(ROBOT), held(POSES[4])
    assert m.rotation is not None
    effort = m.effort.copy()
    effort[source.body.in_legs] += torque
    # the trunk's axes as measured are turned against the true ones by ε: the vertical looks turned by it
    seen = m.rotation @ Rotation.from_rotvec(turn).as_matrix().T
    wrong = replace(
        m, effort=effort, foot_position=foot_positions(ROBOT, m.joint_position[None])[0] + feet, rotation=seen
    )
    errors = np.concatenate([torque, feet.ravel(), turn, np.zeros(12)])
    matrix, target = equilibrium_rows(source, wrong, 1e9, errors)
    theta = np.array([TRUTH.trunk_mass, *(TRUTH.trunk_mass * TRUTH.trunk_com), *errors])
    # to the second order of ε: a few thousandths of a degree of the weight
    np.testing.assert_allclose(matrix @ theta - target, 0.0, atol=1.0)
    matrix, target = equilibrium_rows(source, wrong, 1e9, np.zeros(ERRORS))
    assert np.abs(matrix[:, :4] @ theta[:4] - target).max() > 100.0


def test_level_poses_fall_short_of_the_height_and_say_so() -> None:
    level = fed(PosesCom(ROBOT), (POSES[0], POSES[5], POSES[6])).estimate()
    assert level.observed.tolist() == [True, True, True, False]
    assert level.covariance[0, 0] > 0
    tilted = fed(PosesCom(ROBOT), POSES[:3])
    assert tilted.estimate().observed.all()


def test_memory_is_flat() -> None:
    """However many poses: approach (a) keeps none, the combination the last ones, the rest as information."""
    plain, combined, time = PosesCom(ROBOT), PosesCom(ROBOT, settings=replace(COMBINED, kept=8)), 0.0
    still = [held(pose) for pose in POSES]
    for m in still * 2:
        for _ in range(60):
            time += 0.01
            for estimator in (plain, combined):
                estimator.update(replace(m, time=time))
    assert (len(plain._closed), len(combined._closed)) == (0, 8)
    for estimator in (plain, combined):
        np.testing.assert_allclose(estimator.estimate().trunk.com_trunk, TRUTH.trunk_com, atol=5e-4)


@pytest.mark.parametrize("seed", range(2))
def test_combined_tells_offsets_and_feet_from_the_load(seed: int) -> None:
    """20 N·m on every joint with 1 N·m of scatter, or feet off by 3 cm: the paper's worst, each by one and the same."""
    rng = np.random.default_rng(seed)
    by_torque = fed(PosesCom(ROBOT, settings=COMBINED), POSES, torque=rng.normal(20.0, 1.0, 12)).estimate()
    by_feet = fed(PosesCom(ROBOT, settings=COMBINED), POSES, feet=rng.normal(0.0, 0.03, (4, 3))).estimate()
    assert np.linalg.norm((by_torque.trunk.com_trunk - TRUTH.trunk_com)[:2]) < 0.0026
    assert np.linalg.norm((by_feet.trunk.com_trunk - TRUTH.trunk_com)[:2]) < 0.0021


def test_combined_names_the_offset() -> None:
    offset = np.zeros(12)
    offset[4] = 12.0
    estimator = fed(PosesCom(ROBOT, settings=COMBINED), POSES, torque=offset)
    estimator.estimate()
    joints = [joint for leg in ROBOT.legs for joint in leg.joints]
    assert joints[int(np.argmax(np.abs(estimator._linear_at[:12])))] == ROBOT.tree.joints[4]


def test_a_leg_in_the_air_tells_its_offsets() -> None:
    """Three feet carry; the fourth leg's torques are its own weight and the offsets."""
    q = held(POSES[0]).joint_position
    exact = StandingRobot(ROBOT, 20.0, (-0.4, -0.25, 0.1)).measurement(0.0, q, np.eye(3), carrying=(1, 2, 3))
    offset = np.zeros(12)
    offset[:3] = [4.0, -3.0, 2.0]
    estimator = PosesCom(ROBOT, settings=COMBINED)
    stance = np.array([False, True, True, True])
    for k in range(150):
        estimator.update(replace(exact, time=0.01 * k, effort=exact.effort + offset, stance=stance))
    assert not estimator.estimate().reason
    np.testing.assert_allclose(estimator._linear_at[:3], [4.0, -3.0, 2.0], atol=0.05)


def test_static_poses_are_within_reach() -> None:
    assert all(standing_still(ROBOT, pose) is not None for pose in POSES)
    assert standing_still(ROBOT, PoseOffset(shift=np.array([0.0, 0.0, 3.0]))) is None
