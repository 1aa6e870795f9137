"""The robot as a Pinocchio model: same order, same numbers, other inertias put in."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from stadera.errors import UnknownNameError
from stadera.inertia import InertialParameters
from stadera.lab.pinocchio import pinocchio_model
from stadera.robot import JointDynamics, load_robot


def _reordered(robot, model: pin.Model, v: np.ndarray) -> np.ndarray:
    """A vector in the robot's joint order, in another model's."""
    out = np.zeros(model.nv)
    out[:6] = v[:6]
    for name, value in zip(robot.tree.joints, v[6:], strict=True):
        out[model.joints[model.getJointId(name)].idx_v] = value
    return out


def test_inverse_dynamics_are_those_of_the_raw_file() -> None:
    robot = load_robot("hyq")
    ours, raw = pinocchio_model(robot), pin.buildModelFromUrdf(str(robot.source), pin.JointModelFreeFlyer())
    rng = np.random.default_rng(1)
    for _ in range(5):
        v, a, angles = rng.normal(size=18), rng.normal(size=18), rng.normal(size=12)
        base = pin.randomConfiguration(raw, -np.ones(19), np.ones(19))[:7]
        q_raw = np.concatenate([base, _reordered(robot, raw, np.concatenate([np.zeros(6), angles]))[6:]])
        torque = pin.rnea(ours, ours.createData(), np.concatenate([base, angles]), v, a)
        expected = pin.rnea(raw, raw.createData(), q_raw, _reordered(robot, raw, v), _reordered(robot, raw, a))
        np.testing.assert_allclose(_reordered(robot, raw, torque), expected, atol=1e-9)


def test_joint_order_and_values() -> None:
    robot = load_robot("hyq").with_dynamics({"rh_kfe_joint": JointDynamics(0.3, 0.2, 0.1)})
    model = pinocchio_model(robot)
    assert tuple(model.names)[2:] == robot.tree.joints
    assert model.armature[-1] == 0.3
    assert model.existFrame("rh_foot")
    assert model.existFrame("trunk_imu")


def test_other_inertias_are_put_in() -> None:
    robot = load_robot("hyq")
    heavy = robot.inertias["trunk"] + InertialParameters.from_com(10.0, [0.1, 0, 0.2], np.eye(3))
    loaded = robot.with_inertias({"trunk": heavy})
    assert loaded.mass == pytest.approx(robot.mass + 10)
    assert robot.inertias["trunk"] != heavy
    data = pinocchio_model(loaded).createData()
    assert pin.computeTotalMass(pinocchio_model(loaded), data) == pytest.approx(loaded.mass)


def test_unknown_names_are_refused() -> None:
    robot = load_robot("hyq")
    with pytest.raises(UnknownNameError, match="rh_foot"):
        robot.with_inertias({"rh_foot": InertialParameters.zero()})
    with pytest.raises(UnknownNameError, match="knee"):
        robot.with_dynamics({"knee": JointDynamics()})
