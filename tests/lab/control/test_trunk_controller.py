"""The controller's torques against Pinocchio's equations of motion, and what it does with bad input."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from lab.control.testbed import ROBOTS, bed, load_of, robot_named
from stadera.inertia import skew
from stadera.lab.control.legs import LegDynamics
from stadera.lab.control.reference import ControlError, TrunkPose
from stadera.lab.control.trunk import SmoothTrunk, TrunkController
from stadera.lab.pinocchio import pinocchio_model
from stadera.lab.plant.terrain import Terrain
from stadera.robot import Robot
from stadera.robot.kinematics import foot_positions
from stadera.robot.stance import standing_configuration
from stadera.trunk import ImplausibleError, Measurement, TrunkBounds, TrunkModel, ground_normal


def at_rest(robot: Robot, rotation: np.ndarray) -> Measurement:
    zero = np.zeros(12)
    return Measurement(
        0.0, standing_configuration(robot), zero, zero, np.zeros(3), 9.81 * rotation[2], rotation=rotation
    )


@pytest.mark.parametrize("name", ROBOTS)
def test_equilibrium_by_pinocchio(name: str) -> None:
    """At rest at its reference, with the right belief: g(q) = Sᵀτ + Σ Jᵀ f in all 18 rows, trunk included."""
    robot = robot_named(name)
    robot = robot.with_inertias({robot.trunk: robot.inertias[robot.trunk] + load_of(robot, 0.1).parameters})
    rotation = Terrain(slope=0.2, heading=0.7).rotation
    controller = TrunkController(robot)
    measurement = at_rest(robot, rotation)
    for k in range(400):  # until the forces before are these ones
        torque = controller.update(replace(measurement, time=1e-3 * k))
    model = pinocchio_model(robot)
    data = model.createData()
    q = np.r_[np.zeros(3), pin.Quaternion(rotation).coeffs(), standing_configuration(robot)]
    left = pin.rnea(model, data, q, np.zeros(18), np.zeros(18))
    left[6:] -= torque
    pin.computeJointJacobians(model, data, q)
    feet = foot_positions(robot, standing_configuration(robot)[None])[0] @ rotation.T
    for k, leg in enumerate(robot.legs):
        J = pin.getJointJacobian(model, data, model.getJointId(leg.joints[2]), pin.LOCAL_WORLD_ALIGNED)
        contact = feet[k] - leg.foot_radius * rotation[:, 2]
        arm = contact - data.oMi[model.getJointId(leg.joints[2])].translation
        left -= (J[:3] - skew(arm) @ J[3:]).T @ controller.forces[k]
    np.testing.assert_allclose(left, 0.0, atol=1e-4 * robot.mass * 9.81)


def test_springs_pull_back() -> None:
    robot = robot_named("hyq")
    controller, measurement = TrunkController(robot), at_rest(robot, np.eye(3))
    controller.update(measurement)
    goal = controller.reference
    weight = np.array([0.0, 0.0, controller.forces.sum(axis=0)[2]])
    controller.move(TrunkPose(goal.position + np.array([0.01, -0.02, 0.005]), goal.rotation), 1e-3)
    for k in range(1, 200):
        controller.update(replace(measurement, time=1e-3 * k))
    pull = controller.forces.sum(axis=0) - weight
    np.testing.assert_allclose(pull, controller.gains.stiffness * np.array([0.01, -0.02, 0.005]), rtol=2e-3, atol=0.1)


@pytest.mark.parametrize("bad", ["time", "orientation", "nan"])
def test_bad_measurements_are_refused(bad: str) -> None:
    robot = robot_named("hyq")
    controller = TrunkController(robot)
    good = at_rest(robot, np.eye(3))
    controller.update(good)
    later = replace(good, time=1e-3)
    match bad:
        case "time":
            with pytest.raises(ControlError, match="must increase"):
                controller.update(good)
        case "orientation":
            with pytest.raises(ControlError, match="orientation"):
                controller.update(replace(later, rotation=None))
        case "nan":
            with pytest.raises(ControlError, match="not finite"):
                controller.update(replace(later, joint_velocity=np.full(12, np.nan)))


def test_before_the_first_update_there_is_no_reference() -> None:
    controller = TrunkController(robot_named("hyq"))
    with pytest.raises(ControlError, match="first update"):
        _ = controller.reference
    with pytest.raises(ControlError, match="first update"):
        controller.move(TrunkPose(np.zeros(3), np.eye(3)), 1.0)


def test_implausible_trunks_are_not_taken() -> None:
    robot = robot_named("hyq")
    controller = TrunkController(robot)
    first = controller.trunk.model
    for wrong in (
        TrunkModel(1e4, first.com_trunk),
        TrunkModel(1e-3, first.com_trunk),
        TrunkModel(first.mass, first.com_trunk + np.array([1.0, 0.0, 0.0])),
    ):
        assert not controller.update_trunk(wrong)
    controller.trunk.advance(1.0)
    np.testing.assert_array_equal(controller.trunk.model.com_trunk, first.com_trunk)
    with pytest.raises(ImplausibleError):
        TrunkController(robot, trunk=TrunkModel(first.mass, first.com_trunk + np.array([1.0, 0.0, 0.0])))


def test_a_trunk_on_its_way_stays_in_the_box() -> None:
    robot = robot_named("hyq")
    bounds = TrunkBounds.of(robot)
    belief = SmoothTrunk(TrunkModel(bounds.mass[0], bounds.high), bounds)
    goal = TrunkModel(bounds.mass[1], bounds.low)
    assert belief.accept(goal)
    for _ in range(300):
        belief.advance(1e-3)
        assert bounds.complaint(belief.model) is None or np.allclose(belief.model.com_trunk, bounds.high)
    before = 1.0 - (1.0 + 1e-3 / 0.05) ** -300
    np.testing.assert_allclose((belief.mass - bounds.mass[0]) / (bounds.mass[1] - bounds.mass[0]), before, rtol=1e-9)


def test_torques_stay_within_limits_and_say_so() -> None:
    robot = robot_named("hyq")
    limits = {joint: replace(limit, effort=30.0) for joint, limit in robot.limits.items()}
    controller = TrunkController(replace(robot, limits=limits))
    torque = controller.update(at_rest(robot, np.eye(3)))
    assert controller.saturated.any()
    assert np.abs(torque).max() == 30.0


def test_stance_changes_while_standing() -> None:
    """Over a triangle with the centre of mass inside, a foot can be relieved."""
    robot = robot_named("hyq")
    test = bed(robot)
    test.run(0.2)
    reference = test.controller.reference
    test.controller.move(reference.moved(np.array([-0.12, 0.08, 0.0]), np.zeros(3)), 1.0)
    test.run(1.3)
    test.controller.stance = np.array([True, False, True, True])  # RF, opposite to where the weight went
    test.run(0.5)
    state = test.plant.state
    assert np.linalg.norm(state.foot_force[1]) < 0.01 * robot.mass * 9.81
    np.testing.assert_allclose(state.foot_force.sum(axis=0)[2], robot.mass * 9.81, rtol=0.01)
    assert np.abs(state.joint_velocity[[0, 1, 2, 6, 7, 8, 9, 10, 11]]).max() < 0.05


def test_wrong_foot_positions_move_the_torques_as_their_jacobian_says() -> None:
    """τ = h - Jᵀ f: by the encoders the torques follow the forces through the true Jacobian, else through the wrong."""
    robot = robot_named("hyq")
    measurement = at_rest(robot, np.eye(3))
    feet = foot_positions(robot, measurement.joint_position[None])[0]
    wrong = feet + np.random.default_rng(0).normal(0.0, 0.02, (4, 3))
    bias = LegDynamics(robot).measured(measurement)
    for by_encoders, centres in ((False, wrong), (True, feet)):
        controller = TrunkController(robot, by_encoders=by_encoders)
        torque = controller.update(replace(measurement, foot_position=wrong))
        normal = ground_normal(wrong, np.ones(4, dtype=bool), np.array([0.0, 0.0, 1.0]))
        jacobians = bias.jacobians(centres - 0.02175 * normal)
        expected = bias.bias - np.einsum("kij,ki->kj", jacobians, controller.forces)
        np.testing.assert_allclose(torque[controller.legs.columns], expected, atol=1e-9)
