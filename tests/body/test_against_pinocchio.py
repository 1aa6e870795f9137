"""The rows of any legged robot against Pinocchio: random motions, random contact forces, random inertias."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

from stadera.body import Body, Motion
from stadera.body.tree import State
from stadera.errors import ModelError
from stadera.inertia import InertialParameters
from stadera.lab.pinocchio import pinocchio_model
from stadera.robot import Robot, load_robot
from stadera.robot.catalog import _example_robot_data
from stadera.types import Array

SAMPLES = 5
UP = np.array([0.1, -0.2, 0.97]) / np.linalg.norm([0.1, -0.2, 0.97])
FILES = {
    "b1_z1": ("b1_description/urdf/b1-z1.urdf", [f"{leg}_foot" for leg in ("FL", "FR", "RL", "RR")], 3),
    "bolt": ("bolt_description/robots/bolt.urdf", ["FL_FOOT", "FR_FOOT"], 3),
    "g1": ("g1_description/urdf/g1_29dof_rev_1_0.urdf", ["left_ankle_roll_link", "right_ankle_roll_link"], 6),
    "talos": ("talos_data/robots/talos_full_v2.urdf", ["left_sole_link", "right_sole_link"], 6),
    # the same without the ankles' contact moments: legs with more joints than their contacts have components
    "g1_on_points": ("g1_description/urdf/g1_29dof_rev_1_0.urdf", ["left_ankle_roll_link", "right_ankle_roll_link"], 3),
}


def axis_of(joint: Any) -> Array | None:
    """Unit axis (6,), linear above angular, of a joint of Pinocchio's with one degree of freedom; None of others."""
    data = joint.createData()
    joint.calc(data, np.array([0.0]) if joint.nq == 1 else np.array([1.0, 0.0]))  # an unlimited one has (cos, sin)
    return np.asarray(data.S).reshape(6) if joint.nv == 1 else None


class Case:
    """A robot as Pinocchio's model and as ours; `points` are the contacts' joints and places in their links."""

    def __init__(self, model: Any, body: Body, points: Sequence[tuple[int, Array]]) -> None:
        self.model, self.body, self.points = model, body, points
        model.gravity = pin.Motion.Zero()
        self.mass = pin.computeTotalMass(model)


def of_file(name: str) -> Case:
    folder = _example_robot_data()
    if folder is None:
        pytest.skip("example-robot-data is not installed")
    file, feet, size = FILES[name]
    model = pin.buildModelFromUrdf(str(folder / file), pin.JointModelFreeFlyer())
    # the rows know no mimicking and no unlimited joints' pairs of numbers
    locked = [j for j in range(2, model.njoints) if model.joints[j].nv != 1 or model.joints[j].nq != 1]
    if locked:
        model = pin.buildReducedModel(model, locked, pin.neutral(model))
    n, points = model.njoints - 2, []
    for foot in feet:
        frame = model.frames[model.getFrameId(foot)]
        points.append((frame.parentJoint, np.array(frame.placement.translation)))
    legs = []
    for joint, _ in points:
        chain = [joint]
        while model.parents[chain[0]] > 1:
            chain.insert(0, model.parents[chain[0]])
        legs.append(tuple(j - 2 for j in chain))
    axes = np.array([axis_of(joint) for joint in list(model.joints)[2:]])
    body = Body(
        tuple(model.names)[2:],
        np.array([p - 2 if p > 1 else n for p in list(model.parents)[2:]], dtype=np.int64),
        np.array([placement.rotation for placement in list(model.jointPlacements)[2:]]),
        np.array([placement.translation for placement in list(model.jointPlacements)[2:]]),
        axes[:, :3] + axes[:, 3:],
        axes[:, :3].any(axis=1),
        np.array([InertialParameters.from_pinocchio(inertia).vector for inertia in list(model.inertias)[2:]]),
        np.array(model.armature)[6:],
        *np.zeros((3, n)),
        tuple(legs),
        np.full(len(legs), size, dtype=np.int64),
        np.array([point for _, point in points]),
        np.zeros(len(legs)),
        np.zeros((len(legs), 3)),
        np.zeros(10),
    )
    return Case(model, body, points)


def of_robot(robot: Robot) -> Case:
    model, body = pinocchio_model(robot), Body.of(robot, others=False)
    points = [(2 + leg[-1], point) for leg, point in zip(body.legs, body.points, strict=True)]
    return Case(model, body, points)


@cache
def case(name: str) -> Case:
    return of_file(name) if name in FILES else of_robot(load_robot(name))


def drawn(body: Body, seed: int) -> Motion:
    rng, n = np.random.default_rng(seed), len(body.joints)
    states = rng.uniform(-1.0, 1.0, (3, SAMPLES, n)) * np.array([0.6, 3.0, 20.0])[:, None, None]
    omega, alpha, a = rng.normal(size=(3, SAMPLES, 3)) * np.array([1.0, 5.0, 3.0])[:, None, None]
    return Motion(*states, omega, alpha, a + 9.81 * UP, UP)


def expected(case: Case, motion: Motion, forces: Array) -> tuple[Array, Array, Array, Array]:
    """Of Pinocchio, from contact forces and moments (samples, legs, 6): the trunk's wrench that they and the other
    links leave, the joints' torques, the feet, and their velocities.
    """
    model, body = case.model, case.body
    data, n = model.createData(), len(body.joints)
    q, v, a = np.zeros(model.nq), np.zeros(model.nv), np.zeros(model.nv)
    q[6] = 1.0
    b, tau = np.empty((SAMPLES, 6)), np.empty((SAMPLES, n))
    feet, pace = (np.empty((SAMPLES, len(body.legs), 3)) for _ in range(2))
    for k in range(SAMPLES):
        q[7:], v[6:], a[6:] = motion.position[k], motion.velocity[k], motion.acceleration[k]
        v[3:6], a[3:6], a[:3] = motion.angular_velocity[k], motion.angular_acceleration[k], motion.specific_force[k]
        total = np.array(pin.rnea(model, data, q, v, a))
        twist, change = pin.Motion(v[:6]), pin.Motion(a[:6])
        trunk = model.inertias[1]
        own = (trunk * change + twist.cross(trunk * twist)).vector
        pin.computeJointJacobians(model, data, q)
        for leg, (joint, place) in enumerate(case.points):
            centre = data.oMi[joint].act(place)
            at = centre - body.radii[leg] * motion.normal
            J = np.array(pin.getJointJacobian(model, data, joint, pin.ReferenceFrame.WORLD))
            velocity = J @ v  # of the point at the trunk's origin, which is the world's
            feet[k, leg], pace[k, leg] = centre, velocity[:3] + np.cross(velocity[3:], centre)
            f, m = forces[k, leg, :3], forces[k, leg, 3:]
            total -= J.T @ np.concatenate([f, m + np.cross(at, f)])
        b[k], tau[k] = own - total[:6], total[6:]
    return b, tau, feet, pace


def rows(body: Body, state: State, tau: Array) -> Array:
    left = (state.to_wrench * (state.torque - tau)[..., None]).sum(axis=1)
    return np.asarray(left - state.inertial.sum(axis=1))


@pytest.mark.parametrize("name", ["hyq", "go2", *FILES])
def test_contact_forces_and_inertia_leave_the_trunks_own_wrench(name: str) -> None:
    found = case(name)
    motion, rng = drawn(found.body, 0), np.random.default_rng(1)
    forces = 0.3 * found.mass * 9.81 * rng.normal(size=(SAMPLES, len(found.body.legs), 6))
    forces[..., 3:] *= 0.1 if (found.body.sizes == 6).all() else 0.0
    b, tau, feet, pace = expected(found, motion, forces)
    state = found.body.at(motion)
    scale = found.mass * 9.81 * max(1.0, float(np.abs(tau).max()) / (found.mass * 9.81))
    np.testing.assert_allclose(rows(found.body, state, tau), b, atol=1e-9 * scale, rtol=0.0)
    np.testing.assert_allclose(state.feet, feet, atol=1e-12)
    np.testing.assert_allclose(state.pace, pace, atol=1e-11)


@pytest.mark.parametrize(
    ("name", "axis", "bound"),
    [("h1", (1.0, 0.0, 0.0), 0.015), ("solo_description/robots/solo.urdf", (0.0, 1.0, 0.0), 1.0)],
)
def test_one_joint_less_tells_all_of_a_contact_but_one_component(
    name: str, axis: tuple[float, float, float], bound: float
) -> None:
    """A humanoid's moment about the line along its sole, bounded by half its width; a quadruped's force across its
    legs' planes, bounded by friction.
    """
    folder = _example_robot_data()
    robot = load_robot(folder / name if folder is not None and "/" in name else name)
    found = of_robot(robot)
    assert [leg.unfelt for leg in robot.legs] == len(robot.legs) * [axis]
    assert [leg.unfelt_bound for leg in robot.legs] == pytest.approx(len(robot.legs) * [bound])
    motion, rng, size = drawn(found.body, 0), np.random.default_rng(1), robot.legs[0].contact
    forces = 0.3 * found.mass * 9.81 * rng.normal(size=(SAMPLES, len(robot.legs), 6))
    forces[..., size:] = 0.0
    b, tau, feet, _ = expected(found, motion, forces)
    state = found.body.at(motion)
    own = rows(found.body, state, tau)
    data = found.model.createData()
    for k in range(SAMPLES):
        q = np.concatenate([np.zeros(6), [1.0], motion.position[k]])
        pin.forwardKinematics(found.model, data, q)
        for leg, (joint, _) in enumerate(found.points):
            last = forces[k, leg, size - 3 : size]
            own[k] += (data.oMi[joint].rotation @ found.body.about[leg] @ last) * state.unfelt[k, leg]
    assert np.abs(own - rows(found.body, state, tau)).max() > 10.0
    np.testing.assert_allclose(own, b, atol=1e-9 * float(np.abs(tau).max()), rtol=0.0)
    np.testing.assert_allclose(state.feet, feet, atol=1e-12)


@pytest.mark.parametrize("name", ["go2", "b1_z1", "g1", "h1", "g1_on_points"])
def test_columns_are_what_other_links_change(name: str) -> None:
    """Rows are linear in the links' parameters: what another link changes is its column times the difference."""
    found = case(name)
    motion, rng, n = drawn(found.body, 2), np.random.default_rng(3), len(found.body.joints)
    state, tau = found.body.at(motion, columns=True), rng.normal(size=(SAMPLES, n))
    before, other = rows(found.body, state, tau), found.model.copy()
    change = np.zeros((n, 10))
    for j in range(n):
        mass, centre = rng.uniform(0.5, 2.0), 0.1 * rng.normal(size=3)
        link = InertialParameters.from_com(mass, centre, np.diag(rng.uniform(0.01, 0.015, 3)))
        change[j], other.inertias[2 + j] = link.vector - found.body.parameters[j], link.to_pinocchio()
    quiet = np.zeros((SAMPLES, len(found.body.legs), 6))
    plain = expected(found, motion, quiet)[:2]
    changed = expected(Case(other, found.body, found.points), motion, quiet)[:2]
    # without contact forces b is Σ E (h - τ) - w with τ = h: what changes is E Δh - Δw
    expect = before + (changed[0] - plain[0]) + np.einsum("njc,nj->nc", state.to_wrench, changed[1] - plain[1])
    result = before + np.einsum("njcp,jp->nc", state.columns, change)
    np.testing.assert_allclose(result, expect, atol=1e-9 * np.abs(expect).max())


def test_extra_joints_move_the_trunks_wrench_only_from_their_reference() -> None:
    """B1 with its arm as joints outside the legs: the arm at its reference is part of the trunk."""
    found = case("b1_z1")
    arm = [j for j, leg in enumerate(found.body.leg_of) if leg == len(found.body.legs)]
    assert len(arm) >= 6
    state = found.body.at(drawn(found.body, 4))
    assert not state.to_wrench[:, arm].any()
    assert state.inertial[:, -1].any()


def test_a_leg_with_fewer_joints_than_its_contact_has_components_is_refused() -> None:
    body = case("go2").body
    values = {name: getattr(body, name) for name in Body.__dataclass_fields__}
    with pytest.raises(ModelError, match="a contact of 6 components needs as many joints; leg has FL_hip_joint"):
        Body(**{**values, "sizes": np.full(4, 6)})
