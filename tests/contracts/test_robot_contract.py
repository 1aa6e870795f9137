"""What every robot of the catalog must be, checked against Pinocchio's or MuJoCo's own reading of the raw file."""

from __future__ import annotations

import time

import mujoco
import numpy as np
import pinocchio as pin
import pytest

from stadera.errors import MissingExtraError
from stadera.lab.pinocchio import pinocchio_model
from stadera.robot import CATALOG, LEG_NAMES, Robot, load_robot
from stadera.robot.kinematics import foot_positions, forward_kinematics
from stadera.robot.stance import standing_configuration
from standing import foot_jacobians

_SEED = 5


@pytest.fixture(scope="module", params=CATALOG)
def robot(request: pytest.FixtureRequest) -> Robot:
    return _load(request.param)


@pytest.fixture(scope="module")
def quadruped(robot: Robot) -> Robot:
    if not robot.quadruped:
        pytest.skip(f"{robot.name} has other legs than four of three joints")
    return robot


def _load(name: str) -> Robot:
    try:
        return load_robot(name)
    except MissingExtraError as error:
        pytest.skip(str(error))


def _random_angles(robot: Robot, samples: int = 20) -> np.ndarray:
    return np.random.default_rng(_SEED).uniform(-np.pi, np.pi, (samples, len(robot.tree.joints)))


def _raw_model(robot: Robot) -> pin.Model:
    """Pinocchio's own reading of the file, without any code of ours."""
    source = str(robot.source)
    if source.endswith(".urdf"):
        return pin.buildModelFromUrdf(source, pin.JointModelFreeFlyer())
    return pin.buildModelFromMJCF(source)


def _raw_configuration(robot: Robot, model: pin.Model, angles: np.ndarray) -> np.ndarray:
    q = pin.neutral(model)
    for name, angle in zip(robot.tree.joints, angles, strict=True):
        q[model.joints[model.getJointId(name)].idx_q] = angle
    return q


def test_loads_in_three_seconds(robot: Robot) -> None:
    start = time.perf_counter()
    load_robot(robot.name)
    assert time.perf_counter() - start < 3.0


def test_has_four_legs_of_three_joints_in_order(quadruped: Robot) -> None:
    robot = quadruped
    assert tuple(leg.name for leg in robot.legs) == LEG_NAMES
    assert robot.tree.joints == tuple(joint for leg in robot.legs for joint in leg.joints)
    assert robot.tree.links == (robot.trunk, *(link for leg in robot.legs for link in leg.links))
    for leg in robot.legs:
        chain = [robot.tree.joints[i] for i in robot.tree.ancestors(robot.tree.joints.index(leg.joints[2]))]
        assert tuple(chain) == leg.joints


def test_legs_are_chains_from_the_trunk(robot: Robot) -> None:
    """Of as many joints as their contacts need, in the tree's order, and all of them in the tree."""
    assert robot.tree.joints == tuple(joint for leg in robot.legs for joint in leg.joints)
    for leg in robot.legs:
        assert len(leg.joints) >= leg.contact - any(leg.unfelt)
        chain = [robot.tree.joints[i] for i in robot.tree.ancestors(robot.tree.joints.index(leg.joints[-1]))]
        assert tuple(chain) == leg.joints
        assert robot.leg(leg.name) is leg


def test_legs_are_where_their_names_say(quadruped: Robot) -> None:
    robot = quadruped
    hips = {leg.name: robot.tree.translations[robot.tree.joints.index(leg.joints[0])] for leg in robot.legs}
    centre = np.mean(list(hips.values()), axis=0)
    for name, hip in hips.items():
        assert (hip[0] > centre[0]) == name.endswith("F")
        assert (hip[1] > centre[1]) == name.startswith("L")


def test_own_prefix_finds_the_leg(quadruped: Robot) -> None:
    robot = quadruped
    for leg in robot.legs:
        assert robot.leg(leg.joints[0][:2]) is leg


def test_mass_is_that_of_the_raw_file(robot: Robot) -> None:
    assert robot.mass == pytest.approx(sum(inertia.mass for inertia in _raw_model(robot).inertias), rel=1e-12)


def test_inertias_are_those_of_the_raw_file(robot: Robot) -> None:
    model = _raw_model(robot)
    trunk = [] if robot.extra else [(robot.trunk, model.names[1])]  # with an arm, the trunk has its links' mass too
    for link, joint in (*trunk, *zip(robot.tree.links[1:], robot.tree.joints, strict=True)):
        raw = model.inertias[model.getJointId(joint)]
        found = robot.inertias[link]
        assert found.mass == pytest.approx(raw.mass, rel=1e-12)
        np.testing.assert_allclose(found.com, raw.lever, atol=1e-6)
        np.testing.assert_allclose(found.inertia_com, raw.inertia, atol=1e-6 * raw.mass)


def test_mass_and_moments_are_mujocos() -> None:
    """MJCF only: the whole robot's mass and centre of mass as MuJoCo itself has them."""
    robot = _load("aliengo")
    model = mujoco.MjModel.from_xml_path(str(robot.source))
    data = mujoco.MjData(model)
    data.qpos[:7] = [0, 0, 0, 1, 0, 0, 0]
    mujoco.mj_forward(model, data)
    rotations, translations = forward_kinematics(robot.tree, np.zeros((1, 12)))
    first = sum(
        rotations[0, k] @ robot.inertias[link].first_moment + robot.inertias[link].mass * translations[0, k]
        for k, link in enumerate(robot.tree.links)
    )
    np.testing.assert_allclose(first / robot.mass, data.subtree_com[1], atol=1e-9)
    assert robot.mass == pytest.approx(model.body_subtreemass[1], rel=1e-12)


def test_frames_are_where_the_raw_file_has_them(robot: Robot) -> None:
    model = _raw_model(robot)
    data = model.createData()
    for angles in _random_angles(robot, 5):
        pin.framesForwardKinematics(model, data, _raw_configuration(robot, model, angles))
        rotations, translations = forward_kinematics(robot.tree, angles[None])
        for name, frame in robot.frames.items():
            k = robot.tree.links.index(frame.link)
            kinds = [f for f in model.frames if f.name == name and f.type in (pin.BODY, pin.OP_FRAME)]
            if not kinds:
                assert name in {leg.foot for leg in robot.legs}  # a flat foot's, on its sole
                continue
            raw = data.oMf[model.frames.tolist().index(kinds[0])]
            np.testing.assert_allclose(
                rotations[0, k] @ frame.translation + translations[0, k], raw.translation, atol=1e-9
            )
            np.testing.assert_allclose(rotations[0, k] @ frame.rotation, raw.rotation, atol=1e-9)


def test_feet_are_on_their_frames(robot: Robot) -> None:
    for leg in robot.legs:
        offset = np.linalg.norm(robot.frames[leg.foot].translation - leg.foot_position)
        told = any(leg.foot in note for note in robot.notes)
        assert robot.frames[leg.foot].link == leg.links[-1]
        assert offset < 1e-9 or (told and offset < leg.foot_radius)


def test_kinematics_and_jacobians_are_those_of_its_pinocchio_model(quadruped: Robot) -> None:
    robot = quadruped
    model = pinocchio_model(robot)
    data, q = model.createData(), _random_angles(robot, 10)
    feet, jacobians = foot_positions(robot, q), foot_jacobians(robot, q)
    for n, angles in enumerate(q):
        full = np.concatenate([pin.neutral(model)[:7], angles])
        pin.computeJointJacobians(model, data, full)
        for k, leg in enumerate(robot.legs):
            joint = model.getJointId(leg.joints[2])
            foot = data.oMi[joint].act(np.array(leg.foot_position))
            np.testing.assert_allclose(feet[n, k], foot, atol=1e-9)
            J = pin.getJointJacobian(model, data, joint, pin.LOCAL_WORLD_ALIGNED)
            columns = [model.joints[model.getJointId(name)].idx_v for name in leg.joints]
            lever = foot - data.oMi[joint].translation
            np.testing.assert_allclose(jacobians[n, k], (J[:3] + np.cross(J[3:].T, lever).T)[:, columns], atol=1e-9)


def test_priors_are_finite_and_limits_make_sense(robot: Robot) -> None:
    for link in robot.tree.links:
        assert np.isfinite(robot.inertias[link].vector).all()
        assert robot.inertias[link].mass > 0
    for joint in robot.tree.joints:
        dynamics, limits = robot.dynamics[joint], robot.limits[joint]
        assert min(dynamics.armature, dynamics.viscous, dynamics.coulomb) >= 0
        assert limits.lower < limits.upper
        assert limits.effort > 0
        assert limits.velocity > 0


def test_every_link_has_a_shape(quadruped: Robot) -> None:
    robot = quadruped
    assert {shape.link for shape in robot.shapes} == set(robot.tree.links)
    for shape in robot.shapes:
        assert min(shape.size) > 0
        np.testing.assert_allclose(shape.rotation @ shape.rotation.T, np.eye(3), atol=1e-9)


def test_stands_within_limits_with_its_feet_under_its_hips(quadruped: Robot) -> None:
    robot = quadruped
    q = standing_configuration(robot)
    for joint, angle in zip(robot.tree.joints, q, strict=True):
        assert robot.limits[joint].lower <= angle <= robot.limits[joint].upper
    feet = foot_positions(robot, q[None])[0]
    _, translations = forward_kinematics(robot.tree, q[None])
    hips = np.array([translations[0, robot.tree.links.index(leg.links[1])] for leg in robot.legs])
    reach = hips[:, 2] - feet[:, 2]
    np.testing.assert_allclose(feet[:, 0], hips[:, 0], atol=0.01)
    assert np.ptp(feet[:, 2]) < 0.01
    assert (reach > 0).all()
    stretched = [_stretched(robot, leg.name) for leg in robot.legs]
    assert ((0.55 * np.array(stretched) < reach) & (reach < 0.96 * np.array(stretched))).all()
    left = np.array([leg.name.startswith("L") for leg in robot.legs])
    assert (feet[left, 1] > 0.02).all()
    assert (feet[~left, 1] < -0.02).all()


def _stretched(robot: Robot, name: str) -> float:
    """Farthest distance of a foot from its HFE joint, along the vertical plane's directions, by trying knee angles."""
    leg = robot.leg(name)
    q = np.zeros((721, len(robot.tree.joints)))
    q[:, robot.tree.joints.index(leg.joints[2])] = np.linspace(-np.pi, np.pi, 721)
    feet = foot_positions(robot, q)[:, robot.legs.index(leg)]
    rotations, translations = forward_kinematics(robot.tree, q)
    hfe = robot.tree.joints.index(leg.joints[1])
    axis = rotations[:, hfe + 1] @ robot.tree.axes[hfe]
    arm = feet - translations[:, hfe + 1]
    return float(np.linalg.norm(np.cross(axis, arm), axis=1).max())


def test_any_robot_stands_with_its_soles_level(robot: Robot) -> None:
    q = standing_configuration(robot)
    for leg in robot.legs:
        tree = robot.leg_tree(leg.name)
        angles = q[[robot.tree.joints.index(joint) for joint in leg.joints]]
        assert ((_limits(robot, leg.joints)[0] <= angles) & (angles <= _limits(robot, leg.joints)[1])).all()
        rotations, translations = forward_kinematics(tree, np.stack([angles, np.zeros_like(angles)]))
        if leg.contact == 6:
            np.testing.assert_allclose(rotations[0, -1], rotations[1, -1], atol=1e-6)
            foot = translations[:, -1] + rotations[:, -1] @ np.array(leg.foot_position)
            raised = foot[0] - foot[1]
            np.testing.assert_allclose(raised[:2], 0.0, atol=1e-6)
            assert 0.03 * robot.leg_length < raised[2] < 0.13 * robot.leg_length


def _limits(robot: Robot, joints: tuple[str, ...]) -> np.ndarray:
    return np.array([(robot.limits[joint].lower, robot.limits[joint].upper) for joint in joints]).T
