"""Rows of joint torques, by Pinocchio's account, by energy, and by what columns are there."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pinocchio as pin
import pytest

from body.reference import (
    floating_torques,
    leg_regressor,
    named,
    random_inertias,
    random_motion,
    random_rotation,
    random_tree,
    random_trunk,
    robot_of,
    stack,
)
from stadera.body import (
    Body,
    FrictionModel,
    JointMotion,
    JointTorqueRegressor,
    Motion,
    TrunkMotion,
    inertial_columns,
)
from stadera.errors import IdentificationError, MissingExtraError
from stadera.lab.pinocchio import pinocchio_model
from stadera.robot import Robot, load_robot

HELD = np.array([0.0, 0.0, 1.0])
TILTED = np.array([0.3, -0.5, 0.8])


@cache
def robot_named(name: str) -> Robot:
    try:
        return load_robot(name)
    except MissingExtraError as error:
        pytest.skip(str(error))


@pytest.mark.parametrize("name", ["hyq", "go2", "anymal_c"])
def test_whole_tree_is_newton_euler(name: str) -> None:
    """The torques of a robot that is shaken, with gravity, from the specific force alone."""
    robot = robot_named(name)
    joints, trunk = random_motion(12), random_trunk()
    rng = np.random.default_rng(4)
    rotations = np.stack([random_rotation(rng) for _ in range(len(joints))])
    expected = floating_torques(robot, joints, trunk, rotations)
    found = JointTorqueRegressor(robot.tree).predict(joints, named(dict(robot.inertias), robot.tree.links), trunk)
    np.testing.assert_allclose(found, expected, atol=1e-10 * np.abs(expected).max())


def test_held_trunk_tilted_in_gravity() -> None:
    robot = robot_named("hyq")
    joints, rotation = random_motion(12), random_rotation(np.random.default_rng(5))
    expected = floating_torques(robot, joints, TrunkMotion.held(rotation.T @ HELD), np.stack([rotation] * len(joints)))
    regressor = JointTorqueRegressor(robot.tree)
    parameters = named(dict(robot.inertias), robot.tree.links[1:])
    found = regressor.predict(joints, parameters, TrunkMotion.held(2.0 * rotation.T @ HELD))
    np.testing.assert_allclose(found, expected, atol=1e-10 * np.abs(expected).max())


@pytest.mark.parametrize("seed", range(3))
def test_oblique_axes_in_a_branching_tree(seed: int) -> None:
    tree = random_tree(seed)
    inertias = random_inertias(tree.links, seed)
    robot = robot_of(tree, inertias, robot_named("hyq"))
    joints, trunk = random_motion(4, seed=seed), random_trunk(seed=seed + 10)
    expected = floating_torques(robot, joints, trunk, np.stack([np.eye(3)] * len(joints)))
    found = JointTorqueRegressor(tree).predict(joints, named(inertias, tree.links), trunk)
    np.testing.assert_allclose(found, expected, atol=1e-10 * np.abs(expected).max())


@pytest.mark.parametrize("name", ["hyq", "anymal_c"])
@pytest.mark.parametrize("up", [HELD, TILTED], ids=["level", "tilted"])
def test_leg_is_pinocchios_regressor(name: str, up: np.ndarray) -> None:
    tree = robot_named(name).leg_tree("RH")
    joints = random_motion(3, 40)
    expected = leg_regressor(tree, joints, up)
    regressor = JointTorqueRegressor(tree)
    assert regressor.columns == inertial_columns(tree.links[1:])
    for k, rows in enumerate(regressor.rows(joints, np.zeros((40, 3)), TrunkMotion.held(up))):
        dense = stack([rows], regressor.columns).matrix
        np.testing.assert_allclose(dense, expected[:, k], atol=1e-11 * np.abs(expected).max())
        if up is TILTED:  # a row has the columns that can differ from zero, and no others
            alive = np.abs(expected[:, k]).max(axis=0) > 1e-10
            assert rows.columns == tuple(c for c, a in zip(regressor.columns, alive, strict=True) if a)


def test_torques_pay_for_the_energy() -> None:
    """τ·q̇ = d/dt (kinetic + potential), energies summed up from point velocities of the links, by differences."""
    robot = robot_named("hyq")
    tree, h = robot.leg_tree("RH"), 1e-4
    time = np.linspace(0.0, 2.0, 50)[:, None] + np.array([-h, 0.0, h])
    angle = np.array([0.7, 1.1, 1.6]) * time[..., None] * 3.0 + np.array([0.1, 1.0, 2.0])
    rate = 3.0 * np.array([0.7, 1.1, 1.6])
    swing = np.array([0.4, 0.6, 0.9])
    q, v, a = swing * np.sin(angle), swing * rate * np.cos(angle), -swing * rate**2 * np.sin(angle)
    regressor = JointTorqueRegressor(tree)
    parameters = named(dict(robot.inertias), tree.links[1:])
    torque = regressor.predict(JointMotion(q[:, 1], v[:, 1], a[:, 1]), parameters)
    energy = np.array([[_energy(robot, q[k, i], v[k, i]) for i in (0, 2)] for k in range(len(time))])
    power = (energy[:, 1] - energy[:, 0]) / (2 * h)
    np.testing.assert_allclose(np.sum(torque * v[:, 1], axis=1), power, atol=1e-5 * np.abs(power).max())


def _energy(robot: Robot, position: np.ndarray, velocity: np.ndarray) -> float:
    """Kinetic plus potential energy of the RH leg on a level trunk."""
    tree = robot.leg_tree("RH")
    R, p = np.eye(3), np.zeros(3)
    omega, v = np.zeros(3), np.zeros(3)
    total = 0.0
    for i, link in enumerate(tree.links[1:]):
        v = v + np.cross(omega, R @ tree.translations[i])
        p = p + R @ tree.translations[i]
        R = R @ tree.rotations[i] @ pin.AngleAxis(float(position[i]), tree.axes[i]).toRotationMatrix()
        omega = omega + R @ tree.axes[i] * velocity[i]
        body = robot.inertias[link]
        arm = R @ body.com
        at_com = v + np.cross(omega, arm)
        spin = R.T @ omega
        total += 0.5 * body.mass * at_com @ at_com + 0.5 * spin @ body.inertia_com @ spin
        total += 9.81 * body.mass * (p + arm)[2]
    return total


def test_mass_matrix_is_pinocchios() -> None:
    """Unit accelerations in free space: columns of the composite inertia."""
    robot = robot_named("hyq")
    model = pinocchio_model(robot)
    model.armature[:] = 0.0
    q = np.random.default_rng(2).uniform(-1.0, 1.0, 12)
    M = pin.crba(model, model.createData(), np.r_[0, 0, 0, 0, 0, 0, 1.0, q])
    M = np.triu(M) + np.triu(M, 1).T
    joints = JointMotion(np.tile(q, (12, 1)), np.zeros((12, 12)), np.eye(12))
    parameters = named(dict(robot.inertias), robot.tree.links)
    found = JointTorqueRegressor(robot.tree).predict(joints, parameters, TrunkMotion(np.zeros(3)))
    np.testing.assert_allclose(found, M[6:, 6:], atol=1e-11)


def test_arrays_of_any_order_in_memory() -> None:
    tree, joints = robot_named("hyq").leg_tree("RH"), random_motion(3)
    other = JointMotion(*(np.asfortranarray(x) for x in (joints.position, joints.velocity, joints.acceleration)))
    for a, b in zip(*(JointTorqueRegressor(tree).rows(m, np.zeros((12, 3))) for m in (joints, other)), strict=True):
        np.testing.assert_array_equal(a.matrix, b.matrix)


def test_friction_columns() -> None:
    tree = robot_named("hyq").leg_tree("RH")
    joints = random_motion(3, 30)
    regressor = JointTorqueRegressor(tree, FrictionModel.full())
    parameters = dict.fromkeys(regressor.columns, 0.0)
    for k, joint in enumerate(tree.joints):
        q̇, q̈ = joints.velocity[:, k], joints.acceleration[:, k]
        for term, column in {
            "armature": q̈,
            "viscous": q̇,
            "coulomb": np.tanh(q̇ / 0.02),
            "offset": np.ones(30),
        }.items():
            torque = regressor.predict(joints, parameters | {f"{joint}.{term}": 2.0})
            np.testing.assert_allclose(torque[:, k], 2.0 * column, rtol=1e-14)
            assert not np.delete(torque, k, axis=1).any()


@pytest.mark.parametrize("speed", [0.005, 0.03, 0.2])
def test_identified_friction_is_the_friction_that_every_estimator_uses(speed: float) -> None:
    """The torque of one newton metre of Coulomb friction by the leg's regressor, in the trunk's rows and at rest."""
    plain = robot_named("hyq")
    robot = replace(plain, dynamics={j: replace(d, coulomb=1.0) for j, d in plain.dynamics.items()})
    velocity = speed * np.linspace(-1.0, 1.0, 12)
    still = np.zeros((1, 12))
    names = tuple(f"{joint}.coulomb" for joint in robot.tree.joints)
    regressor = JointTorqueRegressor(robot.tree, FrictionModel(("coulomb",)))
    parameters = dict.fromkeys(regressor.columns, 0.0) | dict.fromkeys(names, 1.0)
    identified = regressor.predict(JointMotion(still, velocity[None], still), parameters)[0]
    rest, with_friction, without = np.zeros((1, 3)), Body.of(robot), Body.of(plain)
    motion = Motion(still, velocity[None], still, rest, rest, rest, np.array([0.0, 0.0, 1.0]))
    state = with_friction.at(motion)
    carried = with_friction.left(state, motion, still) - without.left(state, motion, still)
    np.testing.assert_allclose(carried[0], identified[without.in_legs], atol=1e-9)


@pytest.mark.parametrize("terms", [(), ("armature",), ("offset", "viscous")])
def test_friction_terms_are_switchable(terms: tuple[str, ...]) -> None:
    tree = robot_named("hyq").leg_tree("RH")
    regressor = JointTorqueRegressor(tree, FrictionModel(terms))
    wanted = [t for t in ("armature", "viscous", "coulomb", "offset") if t in terms]
    assert regressor.columns[30:] == tuple(f"{joint}.{t}" for joint in tree.joints for t in wanted)
    full = JointTorqueRegressor(tree, FrictionModel.full())
    joints = random_motion(3)
    for some, all_rows in zip(
        regressor.rows(joints, np.zeros((12, 3))), full.rows(joints, np.zeros((12, 3))), strict=True
    ):
        assert set(some.columns) <= set(all_rows.columns)
        np.testing.assert_array_equal(
            stack([all_rows], full.columns).matrix[:, [*map(full.columns.index, some.columns)]], some.matrix
        )


def test_columns_left_out_are_zero() -> None:
    """A knee's torque depends on the shank alone; no row has another leg's links."""
    robot = robot_named("hyq")
    regressor = JointTorqueRegressor(robot.tree)
    joints = random_motion(12)
    for joint, rows in zip(robot.tree.joints, regressor.rows(joints, np.zeros((12, 12))), strict=True):
        i = robot.tree.joints.index(joint)
        carried = {robot.tree.links[k + 1] for k in range(12) if i in robot.tree.ancestors(k)}
        assert {c.rsplit(".", 1)[0] for c in rows.columns} == carried
    knee = list(regressor.rows(joints, np.zeros((12, 12))))[2]
    assert f"{robot.legs[0].links[2]}.m" not in knee.columns


def test_only_independent_columns_are_worked_out() -> None:
    """Of a hip on a trunk held in any way 17 of 23; what is left out follows from them on other motions too."""
    regressor = JointTorqueRegressor(robot_named("hyq").leg_tree("LF"))
    motion = JointMotion(*np.random.default_rng(5).uniform(-1.0, 1.0, (3, 300, 3)))
    hip = next(regressor.rows(motion, np.zeros((300, 3)), TrunkMotion.held(TILTED)))
    scaled = hip.matrix / np.linalg.norm(hip.matrix, axis=0)
    assert hip.reduced.shape[1] == np.linalg.matrix_rank(scaled, tol=1e-9) == 17 < len(hip.columns)


def test_rows_carry_targets_and_noise() -> None:
    tree = robot_named("hyq").leg_tree("RH")
    joints, torque = random_motion(3), np.random.default_rng(0).normal(size=(12, 3))
    rows = list(JointTorqueRegressor(tree).rows(joints, torque, std=np.array([0.1, 0.2, 0.3])))
    assert [r.std for r in rows] == [0.1, 0.2, 0.3]
    np.testing.assert_array_equal(np.column_stack([r.target for r in rows]), torque)


def test_bad_shapes_are_named() -> None:
    tree = robot_named("hyq").leg_tree("RH")
    regressor = JointTorqueRegressor(tree)
    with pytest.raises(IdentificationError, match=r"\(12, 3\).*got \(12, 4\)"):
        list(regressor.rows(random_motion(3), np.zeros((12, 4))))
    with pytest.raises(IdentificationError, match="motion has 4 joints, the tree 3"):
        list(regressor.rows(random_motion(4), np.zeros((12, 3))))
    with pytest.raises(IdentificationError, match=r"shape \(samples, joints\)"):
        JointMotion(np.zeros((3, 2)), np.zeros((3, 2)), np.zeros((3, 3)))


@pytest.mark.parametrize("up", [(0.0, 0.0, 0.0), (1.0, 2.0), (np.nan, 0.0, 1.0)])
def test_a_vertical_that_is_none(up: tuple[float, ...]) -> None:
    with pytest.raises(IdentificationError, match="vertical"):
        TrunkMotion.held(up)
