"""The batched model of the legs against the raw model file by Pinocchio, and against its evaluation of one sample."""

from __future__ import annotations

import numpy as np
import pytest

from stadera.body import Body, Motion
from stadera.body.friction import JointFriction, direction
from stadera.body.instant import LegDynamics
from stadera.body.instant import inverse_transposed as inverse_of_one
from stadera.body.statics import LegModel, foot_jacobians, foot_positions, inverse_transposed
from stadera.errors import MissingExtraError
from stadera.robot import JointDynamics, Robot, load_robot
from stadera.robot.stance import standing_configuration


def robot_named(name: str) -> Robot:
    try:
        plain = load_robot(name)
    except MissingExtraError as error:
        pytest.skip(str(error))
    return plain.with_dynamics(dict.fromkeys(plain.tree.joints, JointDynamics(0.0, 0.3, 0.5, 0.2)))


def configurations(robot: Robot, samples: int = 5) -> np.ndarray:
    rng = np.random.default_rng(0)
    return standing_configuration(robot) + rng.normal(0.0, 0.2, (samples, len(robot.tree.joints)))


@pytest.mark.parametrize("name", ["hyq", "go2", "anymal_c"])
def test_many_samples_are_as_one_after_the_other(name: str) -> None:
    """Kinematics, weight, and torques of a turning trunk: arrays against Pinocchio, sample by sample."""
    robot = robot_named(name)
    legs, body, single, q = LegModel(robot), Body.of(robot), LegDynamics(robot), configurations(robot)
    rng = np.random.default_rng(1)
    rate, omega, force = rng.standard_normal(q.shape), *rng.standard_normal((2, len(q), 3))
    up = force / np.linalg.norm(force, axis=1, keepdims=True)
    motion = Motion(q, rate, np.zeros_like(q), omega, np.zeros((len(q), 3)), force, up)
    many = body.left(body.at(motion), motion, np.zeros_like(q)).reshape(-1, 4, 3)
    pose = legs.pose(q[:, legs.columns])
    contacts = legs.contacts(pose.feet, up.T)
    by_torque, volume = inverse_transposed(pose.jacobians(contacts))
    for k in range(len(q)):
        one = single.at(q[k], rate[k], omega[k], force[k])
        np.testing.assert_allclose(pose.feet[:, k].T, one.feet, atol=1e-12)
        np.testing.assert_allclose(pose.axis[:, k].swapaxes(0, 1), one.axes, atol=1e-12)
        J = one.jacobians(contacts[:, k].T)
        np.testing.assert_allclose(pose.jacobians(contacts)[:, k].swapaxes(0, 1), J, atol=1e-12)
        np.testing.assert_allclose(by_torque[:, k].swapaxes(0, 1), inverse_of_one(J, 0.0), rtol=1e-8, atol=1e-8)
        np.testing.assert_allclose(volume[k], np.linalg.det(J), atol=1e-12)
        friction = legs.friction.torque(rate[k, legs.columns])
        np.testing.assert_allclose(many[k], one.bias + friction, atol=1e-10)
        at_rest = single.at(q[k], np.zeros_like(q[k]), np.zeros(3), force[k])
        held = np.einsum("ilk,i->lk", legs.weight_torques(pose)[:, k], force[k])
        np.testing.assert_allclose(held, at_rest.bias, atol=1e-10)


def test_jacobians_are_slopes_of_the_feet() -> None:
    robot, step = robot_named("hyq"), 1e-7
    legs, q = LegModel.of(robot), configurations(robot, 3)
    found = foot_jacobians(robot, q)
    for leg in range(4):
        for k in range(3):
            moved = q.copy()
            moved[:, legs.columns[leg, k]] += step
            slope = (foot_positions(robot, moved) - foot_positions(robot, q))[:, leg] / step
            np.testing.assert_allclose(found[:, leg, :, k], slope, atol=1e-6)


def test_a_singular_leg_is_not_solved() -> None:
    robot = robot_named("hyq")
    legs, single = LegModel.of(robot), LegDynamics(robot)
    q, zero = standing_configuration(robot), np.zeros(3)
    q[legs.columns[1]] = 0.0  # stretched
    state = single.at(q, np.zeros(12), zero, zero)
    B = inverse_of_one(state.jacobians(state.feet), legs.least_volume)
    assert np.isnan(B[1]).all()
    assert np.isfinite(B[[0, 2, 3]]).all()


def test_the_model_is_made_once_a_robot() -> None:
    robot = robot_named("hyq")
    assert LegModel.of(robot) is LegModel.of(robot)
    assert LegModel.of(robot) is not LegModel.of(robot_named("hyq"))


def test_friction_opposes_the_motion_by_one_law() -> None:
    robot = robot_named("hyq")
    friction = JointFriction.of(robot)
    velocity = np.array([[0.0, 1.0, -1.0]] * 4)
    np.testing.assert_allclose(friction.torque(velocity), [[0.2, 1.0, -0.6]] * 4, atol=1e-12)
    fitted = friction.torque(velocity, sliding=np.zeros((4, 3)))
    np.testing.assert_allclose(fitted, [[0.2, 0.5, -0.1]] * 4, atol=1e-12)
    np.testing.assert_array_equal(direction(-velocity), -direction(velocity))


def test_forces_at_rest_are_those_of_the_pseudoinverse() -> None:
    """Also in stretched legs, where a direction that no torque feels gets no force."""
    robot, rng = load_robot("go2"), np.random.default_rng(3)
    model = LegModel.of(robot)
    position = rng.uniform(-1.5, 1.5, (300, 4, 3))
    position[:100, :, 2] = rng.normal(0.0, 1e-4, (100, 4))  # stretched; exactly so in ten
    position[:10, :, 2] = 0.0
    effort, force = rng.normal(0.0, 10.0, (300, 4, 3)), np.array([0.5, 0.3, 9.7]) + rng.normal(0.0, 0.5, (300, 3))
    found, contact = model.forces_at_rest(position, effort, force)
    pose = model.pose(position)
    jacobians = pose.jacobians(contact.transpose(2, 0, 1)).transpose(1, 2, 3, 0)
    torque = np.einsum("inlk,ni->nlk", model.weight_torques(pose), force) - effort
    expected = (np.linalg.pinv(jacobians, rcond=1e-3) @ torque[..., None])[..., 0]
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9)
    assert (np.linalg.cond(jacobians) > 1e3).sum() > 100  # both ways are tested
