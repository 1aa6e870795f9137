"""The controllers' model of the legs, by Pinocchio, against the library's kernel and against differences."""

from __future__ import annotations

import numpy as np
import pytest

from stadera.body import Body, Motion
from stadera.body.friction import direction
from stadera.errors import MissingExtraError
from stadera.lab.control.legs import LegDynamics, joint_columns
from stadera.robot import JointDynamics, Robot, load_robot
from stadera.robot.kinematics import foot_positions
from stadera.robot.stance import standing_configuration
from standing import foot_jacobians


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
def test_one_sample_by_pinocchio_is_that_of_the_kernel(name: str) -> None:
    """Kinematics, weight, and torques of a turning trunk."""
    robot = robot_named(name)
    body, single, q, columns = Body.of(robot), LegDynamics(robot), configurations(robot), joint_columns(robot)
    rng = np.random.default_rng(1)
    rate, omega, force = rng.standard_normal(q.shape), *rng.standard_normal((2, len(q), 3))
    up = force / np.linalg.norm(force, axis=1, keepdims=True)
    motion = Motion(q, rate, np.zeros_like(q), omega, np.zeros((len(q), 3)), force, up)
    state = body.at(motion)
    many = body.left(state, motion, np.zeros_like(q)).reshape(-1, 4, 3)
    friction = body.friction(rate, rate)[:, columns]
    for k in range(len(q)):
        one = single.at(q[k], rate[k], omega[k], force[k])
        np.testing.assert_allclose(state.feet[k], one.feet, atol=1e-12)
        np.testing.assert_allclose(state.axis[k][columns].swapaxes(1, 2), one.axes, atol=1e-12)
        J = one.jacobians(state.feet[k] - body.radii[:, None] * up[k])
        by_torque = state.to_wrench[k][columns][..., :3].swapaxes(1, 2)
        np.testing.assert_allclose(by_torque, np.linalg.inv(J.swapaxes(1, 2)), rtol=1e-8, atol=1e-8)
        np.testing.assert_allclose(state.volume[k], np.linalg.det(J), atol=1e-12)
        np.testing.assert_allclose(many[k], one.bias + friction[k], atol=1e-10)


def test_jacobians_are_slopes_of_the_feet() -> None:
    robot, step = robot_named("hyq"), 1e-7
    q, columns = configurations(robot, 3), joint_columns(robot)
    found = foot_jacobians(robot, q)
    for leg in range(4):
        for k in range(3):
            moved = q.copy()
            moved[:, columns[leg, k]] += step
            slope = (foot_positions(robot, moved) - foot_positions(robot, q))[:, leg] / step
            np.testing.assert_allclose(found[:, leg, :, k], slope, atol=1e-6)


def test_friction_opposes_the_motion_by_one_law() -> None:
    robot = robot_named("hyq")
    velocity = np.array([0.0, 1.0, -1.0] * 4)
    np.testing.assert_allclose(Body.of(robot).friction(velocity, velocity), [0.2, 1.0, -0.6] * 4, atol=1e-12)
    np.testing.assert_array_equal(direction(-velocity), -direction(velocity))
