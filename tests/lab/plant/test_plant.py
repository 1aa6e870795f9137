"""The standing plant against Pinocchio's equations of motion and against statics."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from lab.plant.reference import pinocchio_model
from stadera.errors import MissingExtraError, ModelError
from stadera.inertia import InertialParameters, skew
from stadera.lab.plant.payload import DroppedBox, OutsideForce, RigidMass, VirtualForce
from stadera.lab.plant.plant import Plant, SimulationError
from stadera.lab.plant.terrain import Terrain
from stadera.lab.plant.world import TrueState
from stadera.robot import JointDynamics, JointLimits, Robot, load_robot
from stadera.robot.kinematics import foot_positions, forward_kinematics
from stadera.robot.stance import standing_configuration

RAMP = Terrain(slope=np.deg2rad(12.0), heading=0.7)


def damped(robot: Robot) -> Robot:
    """The robot with viscous joints, so that plain springs make it stand still; see `stand`."""
    viscous = JointDynamics(viscous=0.02 * spring(robot))
    return replace(robot, dynamics=dict.fromkeys(robot.tree.joints, viscous))


def spring(robot: Robot) -> float:
    """Stiffness of a joint [N·m/rad], scaled by weight and leg length."""
    height = -foot_positions(robot, standing_configuration(robot)[None])[0, :, 2].mean()
    return 4.0 * 9.81 * robot.mass * float(height)


@pytest.fixture(scope="module")
def hyq() -> Robot:
    return damped(load_robot("hyq"))


def stand(plant: Plant, seconds: float, *, reset: bool = True, sway: float = 0.0) -> None:
    """Joint springs around the nominal stance; `sway` [rad] moves it at 1 Hz."""
    stance, stiffness = standing_configuration(plant.robot), spring(plant.robot)
    if reset:
        plant.reset(stance)
    for _ in range(round(seconds / plant.timestep)):
        plant.step(stiffness * (stance + sway * np.sin(2 * np.pi * plant.time) - plant.joint_position))


def residual(robot: Robot, state: TrueState) -> np.ndarray:
    """M v̇ + h - Sᵀ effort - Σ Jᵀ f, (6 + n,), by Pinocchio, in its local base coordinates."""
    model = pinocchio_model(robot, robot.tree, floating=True)
    data = model.createData()
    R = state.rotation
    q = np.r_[state.position, state.orientation, state.joint_position]
    v = np.r_[R.T @ state.linear_velocity, state.angular_velocity, state.joint_velocity]
    # v_local = Rᵀ v_world, so its derivative is Rᵀ a_world - ω x v_local
    base = R.T @ state.linear_acceleration - np.cross(state.angular_velocity, v[:3])
    a = np.r_[base, state.angular_acceleration, state.joint_acceleration]
    torque = pin.rnea(model, data, q, v, a)
    torque[6:] += [robot.dynamics[joint].viscous for joint in robot.tree.joints] * state.joint_velocity
    torque[6:] -= state.effort
    pin.computeJointJacobians(model, data, q)
    for k, leg in enumerate(robot.legs):
        if not state.foot_contact[k]:
            continue
        joint = model.getJointId(leg.joints[2])
        J = pin.getJointJacobian(model, data, joint, pin.LOCAL_WORLD_ALIGNED)
        arm = state.contact_point[k] - data.oMi[joint].translation
        torque -= (J[:3] - skew(arm) @ J[3:]).T @ state.foot_force[k]
    return torque


def total_com(robot: Robot, state: TrueState, trunk: InertialParameters) -> tuple[float, np.ndarray]:
    """Mass and centre of mass in the world, of a robot whose trunk has these parameters, by forward kinematics."""
    rotations, translations = forward_kinematics(robot.tree, state.joint_position[None])
    total = trunk
    for i, link in enumerate(robot.tree.links[1:], start=1):
        total = total + robot.inertias[link].transformed(rotations[0, i], translations[0, i])
    return total.mass, state.position + state.rotation @ total.com


def assert_balanced(robot: Robot, state: TrueState, trunk: InertialParameters) -> None:
    """At rest the ground carries the weight, and its forces have no moment about the centre of mass."""
    mass, com = total_com(robot, state, trunk)
    weight = mass * 9.81
    np.testing.assert_allclose(state.foot_force.sum(axis=0), [0.0, 0.0, weight], atol=1e-3 * weight)
    moment = np.cross(state.contact_point - com, state.foot_force).sum(axis=0)
    np.testing.assert_allclose(moment / weight, 0.0, atol=2e-4)  # m, an error of the centre of mass


@pytest.mark.parametrize("name", ["hyq", "go2", "anymal_c", "b1"])
def test_stands_and_carries_its_weight(name: str) -> None:
    try:
        robot = damped(load_robot(name))
    except MissingExtraError as error:
        pytest.skip(str(error))
    plant = Plant(robot)
    stand(plant, 5.0)
    state = plant.state
    assert state.foot_contact.all()
    assert np.abs(state.joint_velocity).max() < 1e-2
    assert_balanced(robot, state, robot.inertias[robot.trunk])
    assert plant.truth() == robot.inertias[robot.trunk]


@pytest.mark.parametrize("terrain", [Terrain(), RAMP])
def test_motion_obeys_pinocchios_equations(hyq: Robot, terrain: Terrain) -> None:
    robot = replace(hyq, dynamics=dict.fromkeys(hyq.tree.joints, JointDynamics(armature=0.05, viscous=40.0)))
    plant = Plant(robot, terrain)
    for part in range(5):
        stand(plant, 0.13, reset=part == 0, sway=0.1)
        state = plant.state
        assert np.abs(state.joint_velocity).max() > 0.05
        np.testing.assert_allclose(residual(robot, state), 0.0, atol=1e-6 * 9.81 * robot.mass)  # the contact solver's


def test_payloads_in_motion_obey_pinocchios_equations(hyq: Robot) -> None:
    plant, rigid = Plant(hyq), RigidMass.box(10.0, (0.2, 0.3, 0.1), (0.2, -0.1, 0.2))
    stand(plant, 0.1, sway=0.1)
    plant.apply_payload(rigid)
    stand(plant, 0.2, reset=False, sway=0.1)
    loaded = replace(hyq, inertias={**hyq.inertias, hyq.trunk: plant.truth()})
    np.testing.assert_allclose(residual(loaded, plant.state), 0.0, atol=1e-6 * 9.81 * hyq.mass)
    virtual = VirtualForce(100.0, (-0.3, 0.15, 0.1))
    plant.apply_payload(virtual)
    stand(plant, 0.2, reset=False, sway=0.1)
    force = plant.state.rotation.T @ np.array([0.0, 0.0, -100.0])
    wrench = np.r_[force, np.cross(virtual.position, force), np.zeros(12)]
    np.testing.assert_allclose(residual(loaded, plant.state), wrench, atol=1e-6 * 9.81 * hyq.mass)


@pytest.mark.parametrize("loaded", [False, True])
def test_forces_from_outside_obey_pinocchios_equations(hyq: Robot, loaded: bool) -> None:
    plant, at = Plant(hyq), np.array([0.3, 0.2, 0.1])
    stand(plant, 0.2, sway=0.1)
    if loaded:
        plant.apply_payload(VirtualForce(100.0, (-0.3, 0.15, 0.1)))
    start = plant.state
    plant.pull(OutsideForce(50.0, (0.0, 2.0, 0.0), (0.3, 0.2, 0.1), begin=plant.time, stiffness=2000.0, ramp=0.05))
    stand(plant, 0.2, reset=False, sway=0.1)
    state = plant.state
    moved = state.position + state.rotation @ at - start.position - start.rotation @ at
    pull = state.rotation.T @ np.array([0.0, 50.0 - 2000.0 * moved[1], 0.0])
    weight = state.rotation.T @ np.array([0.0, 0.0, -100.0 * loaded])
    wrench = np.r_[pull + weight, np.cross(at, pull) + np.cross((-0.3, 0.15, 0.1), weight), np.zeros(12)]
    assert abs(2000.0 * moved[1]) > 1.0
    np.testing.assert_allclose(residual(hyq, state), wrench, atol=1e-6 * 9.81 * hyq.mass)


def test_a_wall_does_not_pull_and_a_push_ends() -> None:
    wall = OutsideForce(10.0, (0.0, -1.0, 0.0), begin=1.0, stiffness=1000.0)
    assert wall.force(3.0, np.array([5.0, 0.02, 0.0])) == pytest.approx([0.0, -30.0, 0.0])
    assert not wall.force(3.0, np.array([0.0, -0.02, 0.0])).any()
    push = OutsideForce(10.0, (1.0, 0.0, 0.0), begin=1.0, end=2.0)
    assert push.force(1.5, np.zeros(3))[0] == pytest.approx(10.0)
    assert push.force(1.05, np.zeros(3))[0] == pytest.approx(5.0)
    assert not push.force(2.5, np.zeros(3)).any()


def test_momentum_changes_by_the_forces() -> None:
    hyq = load_robot("hyq")
    plant = Plant(hyq)
    plant.reset(standing_configuration(hyq))
    model = pinocchio_model(hyq, hyq.tree, floating=True)
    data = model.createData()
    momentum, force = [], []
    for _ in range(300):
        plant.step(np.zeros(12))  # collapses
        s = plant.state
        q = np.r_[s.position, s.orientation, s.joint_position]
        v = np.r_[s.rotation.T @ s.linear_velocity, s.angular_velocity, s.joint_velocity]
        momentum.append(pin.computeCentroidalMomentum(model, data, q, v).linear.copy())
        force.append(s.foot_force.sum(axis=0) - [0.0, 0.0, 9.81 * hyq.mass])
    impulse = np.sum(0.5 * (np.array(force[1:]) + force[:-1]), axis=0) * plant.timestep
    change = momentum[-1] - momentum[0]
    assert np.linalg.norm(change) > 10.0
    np.testing.assert_allclose(impulse, change, atol=0.02 * np.linalg.norm(change))


@pytest.mark.parametrize("terrain", [Terrain(), RAMP])
@pytest.mark.parametrize(
    "payload",
    [
        VirtualForce(100.0, (-0.3, 0.15, 0.0)),
        RigidMass.box(10.0, (0.2, 0.3, 0.1), (0.2, -0.1, 0.2)),
        DroppedBox(8.0, position=(-0.15, 0.05)),
    ],
)
def test_truth_with_payload_is_what_the_ground_feels(hyq: Robot, terrain: Terrain, payload: object) -> None:
    plant = Plant(hyq, terrain)
    stand(plant, 0.5)
    plant.apply_payload(payload)
    stand(plant, 6.0, reset=False)
    truth = plant.truth()
    assert truth.mass > hyq.inertias[hyq.trunk].mass + 5.0
    assert_balanced(hyq, plant.state, truth)


def test_payloads_add_up(hyq: Robot) -> None:
    plant = Plant(hyq)
    payloads = (RigidMass.box(3.0, (0.1,) * 3, (0.1, 0, 0.2)), VirtualForce(49.05, (0.0, 0.2, 0.1)))
    stand(plant, 0.1)
    for payload in payloads:
        plant.apply_payload(payload)
    expected = hyq.inertias[hyq.trunk] + payloads[0].parameters + payloads[1].parameters
    np.testing.assert_allclose(plant.truth().vector, expected.vector, atol=1e-12)
    assert payloads[1].parameters.mass == pytest.approx(5.0)


def test_putting_a_box_on_does_not_touch_the_motion(hyq: Robot) -> None:
    plant = Plant(hyq)
    stand(plant, 0.2)
    before = plant.state
    plant.apply_payload(DroppedBox(5.0))
    with_box = plant.state
    for name in ("time", "position", "orientation", "linear_velocity", "joint_position", "joint_velocity"):
        np.testing.assert_array_equal(getattr(with_box, name), getattr(before, name))


def test_slippery_box_falls_off_and_counts_no_more(hyq: Robot) -> None:
    plant = Plant(hyq, Terrain(slope=np.deg2rad(14.0), heading=np.pi / 2))
    stand(plant, 0.3)
    plant.apply_payload(DroppedBox(5.0, friction=0.02, height=0.0))
    plant.step(np.zeros(12))
    assert plant.truth().mass == pytest.approx(hyq.inertias[hyq.trunk].mass + 5.0)
    stand(plant, 1.5, reset=False)
    assert plant.truth() == hyq.inertias[hyq.trunk]


@pytest.mark.parametrize("terrain", [Terrain(), RAMP, Terrain(slope=-0.2)])
def test_reset_puts_the_feet_on_the_ground(hyq: Robot, terrain: Terrain) -> None:
    plant = Plant(hyq, terrain)
    plant.reset(standing_configuration(hyq))
    state = plant.state
    np.testing.assert_allclose(state.rotation, terrain.rotation, atol=1e-12)
    gaps = state.foot_position @ terrain.normal - hyq.legs[0].foot_radius
    assert gaps.min() == pytest.approx(0.0, abs=1e-9)
    assert gaps.max() < 1e-6
    assert plant.time == 0.0


def test_runs_are_reproduced_bit_by_bit(hyq: Robot) -> None:
    first, again = Plant(hyq, RAMP), Plant(hyq, RAMP)
    stand(again, 0.05)
    for plant in (first, again):
        stand(plant, 0.3)
    np.testing.assert_array_equal(first.state.joint_acceleration, again.state.joint_acceleration)
    np.testing.assert_array_equal(first.state.foot_force, again.state.foot_force)


def test_imu_feels_the_motion_of_its_place(hyq: Robot) -> None:
    place = hyq.frames["trunk_imu"]
    moved = replace(place, translation=np.array([0.2, -0.1, 0.05]))
    robot = replace(hyq, frames={**hyq.frames, "trunk_imu": moved})
    plant = Plant(robot)
    stand(plant, 0.2, sway=0.15)
    s, arm = plant.state, moved.translation
    omega = s.angular_velocity
    lever = np.cross(s.angular_acceleration, arm) + np.cross(omega, np.cross(omega, arm))
    specific = s.rotation.T @ (s.linear_acceleration + np.array([0.0, 0.0, 9.81])) + lever
    np.testing.assert_allclose(plant.imu_motion[:3], moved.rotation.T @ omega, atol=1e-9)
    np.testing.assert_allclose(plant.imu_motion[3:], moved.rotation.T @ specific, atol=1e-8)


def test_torque_saturates_and_friction_holds(hyq: Robot) -> None:
    limits = {joint: JointLimits(effort=30.0) for joint in hyq.tree.joints}
    plant = Plant(replace(hyq, limits=limits))
    plant.reset(standing_configuration(hyq))
    plant.step(np.full(12, 100.0))
    np.testing.assert_array_equal(plant.effort, 30.0)


def test_friction_cone_is_kept(hyq: Robot) -> None:
    terrain = Terrain(slope=np.deg2rad(15.0), friction=0.5)
    plant = Plant(hyq, terrain)
    stand(plant, 0.5, sway=0.1)
    force = plant.state.foot_force
    normal = force @ terrain.normal
    tangential = np.linalg.norm(force - np.outer(normal, terrain.normal), axis=1)
    assert (normal >= 0).all()
    assert (tangential <= 0.5 * normal * (1 + 1e-6) + 1e-9).all()


def test_bad_input_is_named(hyq: Robot) -> None:
    plant = Plant(hyq)
    plant.reset(standing_configuration(hyq))
    with pytest.raises(SimulationError, match=r"shape \(12,\)"):
        plant.step(np.zeros(11))
    with pytest.raises(SimulationError, match="joint torques are not finite at joint 'rf_"):
        plant.step(np.where([j.startswith("rf_haa") for j in hyq.tree.joints], np.nan, 0.0))
    with pytest.raises(SimulationError, match="joint positions are not finite"):
        plant.reset(np.full(12, np.inf))
    with pytest.raises(ModelError, match="slope"):
        Terrain(slope=2.0)
