"""Contact forces against Pinocchio's inverse dynamics and against finite differences."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from stadera.body import Body
from stadera.body import Motion as BodyMotion
from stadera.errors import MissingExtraError, ModelError
from stadera.inertia import skew
from stadera.lab.laws.equilibrium import ForceNoise, wrench_slope
from stadera.lab.laws.static import white_covariance
from stadera.lab.pinocchio import pinocchio_model
from stadera.robot import JointDynamics, Robot, load_robot
from stadera.robot.kinematics import foot_positions
from stadera.robot.stance import standing_configuration
from stadera.trunk import (
    ContactForceEstimator,
    Measurement,
    ground_normal,
)

ROBOTS = ("hyq", "go2", "anymal_c", "b1")
GRAVITY = np.array([0.0, 0.0, -9.81])


def robot_named(name: str) -> Robot:
    try:
        return load_robot(name)
    except MissingExtraError as error:
        pytest.skip(str(error))


def with_joint_dynamics(robot: Robot) -> Robot:
    """Every joint with a rotor, friction and an offset."""
    dynamics = JointDynamics(armature=0.03, viscous=0.2, coulomb=0.5, offset=0.3)
    return replace(robot, dynamics=dict.fromkeys(robot.tree.joints, dynamics))


def contact_jacobian(model: pin.Model, data: pin.Data, robot: Robot, leg: int, point: np.ndarray) -> np.ndarray:
    """(3, 18) of a point of the world that moves with a leg's last link, by Pinocchio, rows in world axes."""
    joint = model.getJointId(robot.legs[leg].joints[2])
    J = pin.getJointJacobian(model, data, joint, pin.LOCAL_WORLD_ALIGNED)
    return J[:3] - skew(point - data.oMi[joint].translation) @ J[3:]


class Motion:
    """A random motion with random contact forces, and the joint torques and trunk wrench that go with it."""

    def __init__(self, robot: Robot, seed: int, moving: float = 1.0) -> None:
        rng = np.random.default_rng(seed)
        model = pinocchio_model(robot)
        data = model.createData()
        R = pin.exp3(rng.normal(0.0, 0.3, 3))
        self.joint = standing_configuration(robot) + rng.normal(0.0, 0.1, 12)
        self.rate, self.joint_acceleration = moving * rng.normal(0.0, 1.0, (2, 12))
        self.omega, self.alpha, local = moving * rng.normal(0.0, 1.0, (3, 3))
        q = np.r_[rng.normal(0.0, 1.0, 3), pin.Quaternion(R).coeffs(), self.joint]
        v = np.r_[moving * rng.normal(0.0, 1.0, 3), self.omega, self.rate]
        a = np.r_[local, self.alpha, self.joint_acceleration]
        self.rotation = R
        # acceleration of the trunk's origin in trunk axes: v̇ + ω x v; specific force: minus gravity
        self.specific = local + np.cross(self.omega, v[:3]) - R.T @ GRAVITY
        torque = pin.rnea(model, data, q, v, a)  # with armature
        pin.computeJointJacobians(model, data, q)
        feet = foot_positions(robot, self.joint[None])[0]
        self.normal = ground_normal(feet, np.ones(4, dtype=bool), R[2])
        radii = np.array([[leg.foot_radius] for leg in robot.legs])
        self.contact = feet - radii * self.normal
        share = rng.uniform(0.15, 0.35, (4, 1)) * robot.mass * 9.81
        self.force = share * (self.normal + rng.normal(0.0, 0.1, (4, 3)))
        for leg in range(4):
            point = q[:3] + R @ self.contact[leg]
            torque -= contact_jacobian(model, data, robot, leg, point).T @ (R @ self.force[leg])
        joints = [robot.dynamics[joint] for joint in robot.tree.joints]
        self.effort = torque[6:] + [
            d.viscous * rate + d.coulomb * np.tanh(rate / 0.02) + d.offset
            for d, rate in zip(joints, self.rate, strict=True)
        ]

    def measurement(self) -> Measurement:
        return Measurement(0.0, self.joint, self.rate, self.effort, self.omega, self.specific, rotation=self.rotation)

    def batch(self, robot: Robot) -> np.ndarray:
        """Forces (4, 3) [N] by the model for many samples, accelerations included."""
        joints = (x[None] for x in (self.joint, self.rate, self.joint_acceleration))
        trunk = (x[None] for x in (self.omega, self.alpha, self.specific))
        body, motion = Body.of(robot), BodyMotion(*joints, *trunk, self.normal)
        state = body.at(motion)
        return body.contacts(state, body.left(state, motion, self.effort[None]))[0, :, :3]


@pytest.mark.parametrize("name", ROBOTS)
def test_a_moving_robots_forces_by_pinocchio(name: str) -> None:
    robot = with_joint_dynamics(robot_named(name))
    for seed in range(3):
        motion = Motion(robot, seed)
        np.testing.assert_allclose(motion.batch(robot), motion.force, atol=1e-8 * robot.mass * 9.81)


@pytest.mark.parametrize("name", ROBOTS)
def test_one_sample_at_rest_by_pinocchio(name: str) -> None:
    robot = with_joint_dynamics(robot_named(name))
    estimator = ContactForceEstimator(robot)
    for seed in range(3):
        motion = Motion(robot, seed, moving=0.0)
        found = estimator.at(motion.measurement())
        assert found.stance.all()
        np.testing.assert_allclose(found.force, motion.force, atol=1e-8 * robot.mass * 9.81)
        np.testing.assert_allclose(found.normal, motion.normal, atol=1e-12)
        total = motion.force.sum(axis=0)
        moment = np.cross(motion.contact, motion.force).sum(axis=0)
        np.testing.assert_allclose(found.wrench, np.r_[total, moment], atol=1e-7 * robot.mass)


def test_one_sample_and_many_agree_in_motion_without_acceleration() -> None:
    robot = with_joint_dynamics(load_robot("hyq"))
    motion = Motion(robot, 1)
    motion.joint_acceleration = np.zeros(12)
    motion.alpha = np.zeros(3)
    single = ContactForceEstimator(robot).at(motion.measurement())
    np.testing.assert_allclose(single.force, motion.batch(robot), atol=1e-8)


def test_slopes_and_covariance_of_torques_by_finite_differences() -> None:
    robot = load_robot("hyq")
    noise = ForceNoise(np.arange(1.0, 13.0), np.full(12, 0.5))
    estimator = ContactForceEstimator(robot)
    measurement = Motion(robot, 0, moving=0.0).measurement()
    at = estimator.at(measurement)
    jacobian = np.empty((6, 12))
    for k in range(12):
        nudged = measurement.effort.copy()
        nudged[k] += 1e-3
        jacobian[:, k] = (estimator.at(replace(measurement, effort=nudged)).wrench - at.wrench) / 1e-3
    order = estimator.body.in_legs
    variance = np.empty(12)
    variance[order] = noise.torque_white**2
    expected = jacobian * variance @ jacobian.T
    np.testing.assert_allclose(white_covariance(at, noise), expected, rtol=1e-6, atol=1e-8)
    np.testing.assert_allclose(wrench_slope(at)[:, :12], jacobian[:, order], rtol=1e-6, atol=1e-6)


def test_slopes_of_foot_positions_by_finite_differences() -> None:
    robot = load_robot("hyq")
    motion = Motion(robot, 0, moving=0.0)
    feet = foot_positions(robot, motion.joint[None])[0]
    measurement = replace(motion.measurement(), foot_position=feet)
    small_feet = replace(robot, legs=tuple(replace(leg, foot_radius=0.0) for leg in robot.legs))
    still_normal = ContactForceEstimator(small_feet)
    at = still_normal.at(measurement)
    slopes = np.empty((6, 12))
    for k in range(12):
        moved = feet.copy()
        moved.flat[k] += 1e-6
        slopes[:, k] = (still_normal.at(replace(measurement, foot_position=moved)).wrench - at.wrench) / 1e-6
    np.testing.assert_allclose(wrench_slope(at)[:, 12:], slopes, rtol=1e-4, atol=1e-2)


def test_a_stretched_leg_is_not_weighed() -> None:
    robot = load_robot("hyq")
    motion = Motion(robot, 0, moving=0.0)
    knee = robot.tree.joints.index(robot.leg("RF").joints[2])
    # where the knee is stretched: the point of contact in line with thigh and hip
    angles = np.linspace(-0.2, 0.2, 401)
    joint = np.tile(motion.joint, (len(angles), 1))
    joint[:, knee] = angles
    still, rest = np.zeros_like(joint), np.zeros((len(joint), 3))
    volume = Body.of(robot).at(BodyMotion(joint, still, still, rest, rest, rest, motion.normal)).volume
    motion.joint = joint[np.argmin(np.abs(volume[:, 1]))]
    found = ContactForceEstimator(robot).at(motion.measurement())
    assert np.isnan(found.force[1]).all()
    assert not found.stance[1]
    assert np.isfinite(found.wrench).all()
    assert np.isfinite(wrench_slope(found)).all()


def test_a_foot_in_the_air_does_not_carry() -> None:
    robot = load_robot("hyq")
    motion = Motion(robot, 0, moving=0.0)
    free = motion.measurement()
    forces, effort = ContactForceEstimator(robot).at(free), free.effort.copy()
    effort[forces.body.in_legs[6:9]] += forces.left[6:9]  # LH holds itself, no more
    found = ContactForceEstimator(robot).at(replace(free, effort=effort))
    np.testing.assert_array_equal(found.stance, [True, True, False, True])
    np.testing.assert_allclose(found.force[2], 0.0, atol=1e-9)
    told = ContactForceEstimator(robot).at(replace(free, stance=np.array([True, True, False, True])))
    np.testing.assert_array_equal(told.stance, [True, True, False, True])


def test_normals_of_planes() -> None:
    rng = np.random.default_rng(0)
    R = pin.exp3(np.array([0.2, -0.3, 0.1]))
    feet = np.array([[0.4, 0.2, 0.0], [0.35, -0.2, 0.0], [-0.4, 0.25, 0.0], [-0.3, -0.2, 0.0]]) @ R.T
    up = np.array([0.0, 0.0, 1.0])
    for missing in (None, 0, 1, 2, 3):
        stance = np.arange(4) != (-1 if missing is None else missing)
        moved = feet.copy()
        if missing is not None:
            moved[missing] += rng.normal(0.0, 0.3, 3)
        np.testing.assert_allclose(ground_normal(moved, stance, up), R[:, 2], atol=1e-12)
    np.testing.assert_array_equal(ground_normal(feet, np.array([True, False, False, True]), up), up)
    many = ground_normal(np.stack([feet, feet]), np.ones((2, 4), dtype=bool), np.stack([up, up]))
    np.testing.assert_allclose(many, [R[:, 2], R[:, 2]], atol=1e-12)


def test_bad_input_is_named() -> None:
    robot = load_robot("hyq")
    with pytest.raises(ModelError, match="each joint of the legs"):
        ForceNoise(np.ones(12), np.ones((4, 3)))
    with pytest.raises(ModelError, match=r"\(samples, 12\)"):
        foot_positions(robot, np.zeros((1, 11)))
