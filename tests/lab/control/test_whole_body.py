"""Robots on flat feet in the test-bed: they stand, sway and squat, and what is logged obeys Newton and Euler."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from stadera.constants import GRAVITY
from stadera.errors import MissingExtraError, StaderaError
from stadera.inertia import InertialParameters
from stadera.lab.plant.sensors import truth_of
from stadera.lab.plant.whole import as_loaded, whole_robot
from stadera.lab.plant.world import TrueState
from stadera.lab.scenarios.catalog import Load, SimulateSettings
from stadera.lab.scenarios.run import Run, simulate
from stadera.lab.truth import truth_json
from stadera.logs import Recording
from stadera.robot import Robot, load_robot
from stadera.robot.sole import sole
from stadera.types import Array

HANDS = {"g1": "left_wrist_yaw_link", "talos": "arm_left_7_link", "b1_z1": "link06"}


def of_name(name: str) -> Robot:
    try:
        return load_robot(name)
    except MissingExtraError as error:
        pytest.skip(str(error))


def residual(robot: Robot, run: Run, states: list[TrueState]) -> Array:
    """Torques and trunk's wrench (samples, 6 + joints) that Pinocchio's model of the file, with the load, needs beyond
    the actuators' and the wrenches of the feet, which the legs' own torques determine.
    """
    model, joints = pin.buildModelFromUrdf(str(robot.source), pin.JointModelFreeFlyer()), run.recording.joints
    locked = [j for j in range(2, model.njoints) if model.names[j] not in joints]
    model = pin.buildReducedModel(model, locked, pin.neutral(model)) if locked else model
    now = run.truth.at(states[-1].time)
    assert now.link == HANDS[robot.name]
    load = InertialParameters.from_com(now.payload_mass, now.payload_com, now.payload_mass * 0.01 / 6.0 * np.eye(3))
    model.inertias[model.frames[model.getFrameId(now.link)].parentJoint] += load.to_pinocchio()
    order = [model.joints[model.getJointId(joint)] for joint in joints]
    legs = [model.joints[model.getJointId(joint)].idx_v for leg in robot.legs for joint in leg.joints]
    in_q, in_v = [joint.idx_q for joint in order], [joint.idx_v for joint in order]
    data, left = model.createData(), []
    for state in states[5::20]:
        q, v, a, tau = pin.neutral(model), *np.zeros((3, model.nv))
        q[3:7], q[in_q], v[in_v] = state.orientation, state.joint_position, state.joint_velocity
        a[in_v], tau[in_v], v[3:6] = state.joint_acceleration, state.effort, state.angular_velocity
        a[:3], a[3:6] = state.rotation.T @ state.linear_acceleration, state.angular_acceleration  # at an origin at rest
        needed = np.array(pin.rnea(model, data, q, v, a)) - tau
        pin.computeJointJacobians(model, data, q)
        jacobians = []
        for leg in robot.legs:
            joint = model.getJointId(leg.joints[-1])
            J = np.array(pin.getJointJacobian(model, data, joint, pin.ReferenceFrame.WORLD))
            J[:3] -= pin.skew(data.oMi[joint].act(np.array(leg.foot_position)) - [0.0, 0.0, leg.foot_radius]) @ J[3:]
            jacobians.append(J[: leg.contact])
        stacked = np.vstack(jacobians)
        left.append(needed - stacked.T @ np.linalg.solve(stacked[:, legs].T, needed[legs]))
    return np.array(left)


@pytest.mark.parametrize(("name", "scenario"), [("g1", "shake"), ("talos", "squat"), ("b1_z1", "crawl")])
def test_what_is_logged_obeys_newton_and_euler(name: str, scenario: str, monkeypatch: pytest.MonkeyPatch) -> None:
    robot, states = of_name(name), list[TrueState]()

    def keep(given: Sequence[TrueState], whole: Robot) -> Recording:
        states.extend(given)
        return truth_of(given, whole)

    monkeypatch.setattr("stadera.lab.scenarios.run.truth_of", keep)
    load = Load(0.05 * robot.mass, at=(0.05, 0.0, 0.02), on=HANDS[name])
    settings = SimulateSettings("ideal", load, duration=1.6, rate=1000.0, load_time=0.0, arms=0.3)
    run = simulate(robot, scenario, settings)
    left = residual(robot, run, states)
    assert np.abs(left).max() < 1e-5 * robot.mass * GRAVITY, np.abs(left).max(axis=0)
    others = [k for k, joint in enumerate(run.recording.joints) if joint not in robot.tree.joints]
    assert np.ptp(run.recording.position[:, others], axis=0).max() > 0.2


def test_a_humanoid_squats_on_both_feet() -> None:
    robot = of_name("g1")
    run = simulate(robot, "squat", SimulateSettings("real", duration=3.0, seed=1, hold=2))
    assert run.truth.fell is None
    knees = [run.recording.index(leg.joints[3]) for leg in robot.legs]
    assert np.ptp(run.true_motion.position[:, knees], axis=0).min() > 0.3
    weight = sum(run.true_motion.foot_force[leg.foot][:, 2].mean() for leg in robot.legs)
    assert weight == pytest.approx(9.81 * robot.mass, rel=0.04)  # links are drawn 5 % wrong, each
    assert run.truth.drawn is not None
    share = [
        value["coulomb"] / robot.limits[joint].effort
        for joint, value in run.truth.drawn["joints"].items()
        if joint in robot.limits
    ]
    assert min(share) >= 0.03
    assert max(share) <= 0.08
    assert min(run.truth.drawn["compliance"].values()) > 0.0


def test_a_robot_of_any_legs_that_falls_is_said_to() -> None:
    robot = of_name("g1")
    load = Load(0.4 * robot.mass, at=(0.2, 0.0, 0.0))
    run = simulate(robot, "stand", SimulateSettings("ideal", load, duration=1.6, load_time=0.3))
    assert run.truth.fell is not None
    time, how = run.truth.fell
    assert how == "the trunk tilted by more than 45°"
    assert 0.3 < time < run.recording.time[-1] < time + 0.2  # the log ends with the fall
    assert truth_json(run.truth)["fell"] == {"time": time, "how": how}


def test_soles_are_the_spheres_or_the_mesh_of_the_foot() -> None:
    robot = of_name("talos")
    points, radius = sole(robot, robot.legs[0])
    assert points.shape == (4, 3)
    np.testing.assert_allclose(points[:, 2] - radius, robot.legs[0].foot_position[2], atol=1e-3)
    assert 0.1 < np.ptp(points[:, 1]) < 0.2 < np.ptp(points[:, 0]) < 0.3


def test_what_cannot_be_simulated_is_said_by_name() -> None:
    with pytest.raises(StaderaError, match=r"robot icub: link .* is no body that can be simulated: The 3d inertia"):
        simulate(of_name("icub"), "stand")
    robot = of_name("g1")
    bare = replace(robot, shapes=(), source=None)
    with pytest.raises(StaderaError, match=r"the flat foot .* has no spheres, boxes or meshes to stand on"):
        sole(bare, bare.legs[0])


def test_a_whole_robot_is_the_one_that_is_loaded() -> None:
    robot = of_name("g1")
    whole = whole_robot(robot)
    assert whole.mass == pytest.approx(robot.mass)
    assert len(whole.tree.joints) == 29
    again = as_loaded(whole, robot)
    for link in robot.tree.links:
        np.testing.assert_allclose(again.inertias[link].vector, robot.inertias[link].vector, atol=1e-12)
    with pytest.raises(StaderaError, match="robot g1 is no quadruped of three joints a leg: it can stand, "):
        simulate(robot, "trot")
