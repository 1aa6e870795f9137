"""The compiled MuJoCo model against Pinocchio's recursive algorithms."""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np
import pinocchio as pin
import pytest

from lab.plant.reference import inverse_dynamics, pinocchio_model
from stadera.errors import MissingExtraError, ModelError
from stadera.inertia import InertialParameters
from stadera.lab.plant.model import build_model, mass_matrix, workspace
from stadera.robot import JointDynamics, Robot, load_robot

TOLERANCE = 1e-9


@pytest.fixture(scope="module", params=("hyq", "go2", "anymal_c", "b1"))
def robot(request: pytest.FixtureRequest) -> Robot:
    """A robot whose joints add only their armature to the rigid links."""
    try:
        robot = load_robot(request.param)
    except MissingExtraError as error:
        pytest.skip(str(error))
    armature = {joint: JointDynamics(armature=0.01 * k) for k, joint in enumerate(robot.tree.joints)}
    return replace(robot, dynamics=armature)


def test_floating_robot_has_pinocchios_mass_matrix_and_bias(robot: Robot) -> None:
    model = build_model(robot, floating=True)
    data = mujoco.MjData(model)
    reference = pinocchio_model(robot, robot.tree, floating=True)
    reference_data = reference.createData()
    rng = np.random.default_rng(3)
    for position in workspace(robot, robot.tree, 20):
        quat = rng.normal(size=4)
        quat /= np.linalg.norm(quat)
        base, velocity = rng.normal(size=3), rng.normal(size=model.nv)
        rotation = pin.Quaternion(quat).toRotationMatrix()  # from xyzw
        data.qpos[:] = np.r_[base, quat[[3, 0, 1, 2]], position]
        data.qvel[:] = velocity
        mujoco.mj_forward(model, data)
        # MuJoCo's base velocity is (world linear, local angular), Pinocchio's is local: v_pin = T v_mj, M_mj = Tᵀ M T
        to_local = np.eye(model.nv)
        to_local[:3, :3] = rotation.T
        q = np.r_[base, quat, position]
        local = to_local @ velocity
        M = pin.crba(reference, reference_data, q)
        # the world acceleration is R (a_local + ω x v_local), so M_mj v̇_mj = 0 hides a local acceleration -ω x v
        coriolis = np.zeros(model.nv)
        coriolis[:3] = -np.cross(local[3:6], local[:3])
        bias = to_local.T @ pin.rnea(reference, reference_data, q, local, coriolis)
        bias -= to_local.T @ np.r_[np.zeros(6), reference.armature[6:] * coriolis[6:]]
        np.testing.assert_allclose(mass_matrix(model, data), to_local.T @ M @ to_local, atol=TOLERANCE)
        np.testing.assert_allclose(data.qfrc_bias, bias, atol=TOLERANCE * max(1.0, np.abs(bias).max()))


def test_every_held_leg_has_pinocchios_inverse_dynamics(robot: Robot) -> None:
    rng = np.random.default_rng(4)
    for leg in robot.legs:
        tree = robot.leg_tree(leg.name)
        model = build_model(robot, tree)
        data = mujoco.MjData(model)
        position = workspace(robot, tree, 20)
        velocity, acceleration = rng.normal(size=(2, 20, 3)) * 5.0
        torque = np.empty_like(position)
        for k in range(20):
            data.qpos[:], data.qvel[:] = position[k], velocity[k]
            mujoco.mj_forward(model, data)
            data.qacc[:] = acceleration[k]
            mujoco.mj_inverse(model, data)
            torque[k] = data.qfrc_inverse
        expected = inverse_dynamics(robot, tree, position, velocity, acceleration)
        np.testing.assert_allclose(torque, expected, atol=TOLERANCE * np.abs(expected).max())


def test_links_that_are_not_physical_are_simulated_as_given() -> None:
    robot = load_robot("hyq")
    leg = robot.leg("RH")
    tree = robot.leg_tree("RH")
    lower = robot.inertias[leg.links[2]].vector.copy()
    lower[4] = -0.0152  # Table I's lower limb
    robot = replace(
        robot,
        inertias={**robot.inertias, leg.links[2]: InertialParameters(lower)},
        dynamics=dict.fromkeys(robot.tree.joints, JointDynamics()),
    )
    assert not robot.inertias[leg.links[2]].is_physical()
    model = build_model(robot, tree)
    data = mujoco.MjData(model)
    position, velocity, acceleration = np.random.default_rng(5).normal(size=(3, 3))
    data.qpos[:], data.qvel[:] = position, velocity
    mujoco.mj_forward(model, data)
    data.qacc[:] = acceleration
    mujoco.mj_inverse(model, data)
    expected = inverse_dynamics(robot, tree, position[None], velocity[None], acceleration[None])[0]
    np.testing.assert_allclose(data.qfrc_inverse, expected, atol=TOLERANCE)


def test_mass_matrix_that_is_not_positive_definite_is_refused() -> None:
    robot = load_robot("hyq")
    link = robot.leg("LF").links[2]
    bad = robot.inertias[link].vector.copy()
    bad[4:] = -1.0
    with pytest.raises(ModelError, match=f"not positive definite.*{link}"):
        build_model(replace(robot, inertias={**robot.inertias, link: InertialParameters(bad)}))


def test_joint_dynamics_and_limits_reach_the_model() -> None:
    robot = load_robot("hyq")
    joint = robot.tree.joints[1]
    given = JointDynamics(armature=0.1, viscous=0.2, coulomb=0.3)
    model = build_model(replace(robot, dynamics={**robot.dynamics, joint: given}))
    dof = model.joint(joint).dofadr[0]
    assert model.dof_armature[dof] == 0.1
    assert model.dof_damping[dof] == 0.2
    assert model.dof_frictionloss[dof] == 0.3
    assert model.actuator(joint).forcerange[1] == robot.limits[joint].effort
