"""A leg on a held trunk: what is recorded obeys the equations of motion, by Pinocchio's account of them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest

from lab.plant.reference import inverse_dynamics
from stadera.errors import ModelError
from stadera.lab.plant.leg import Gains, perturbed, simulate_leg
from stadera.logs import Recording
from stadera.robot import JointDynamics, JointLimits, Robot, load_robot

FRICTION = JointDynamics(armature=0.02, viscous=0.7, coulomb=1.5, offset=-0.4)


@dataclass(frozen=True, eq=False)
class Reference:
    time: np.ndarray
    position: np.ndarray
    velocity: np.ndarray


def sinusoids(duration: float = 4.0, rate: float = 1000.0) -> Reference:
    time = np.arange(round(duration * rate)) / rate
    amplitude, frequency = np.array([0.25, 0.2, 0.4]), 2 * np.pi * np.array([0.5, 0.7, 0.9])
    origin = np.array([0.1, 0.5, -1.2])
    phase = np.outer(time, frequency) + np.array([0.2, 1.0, 2.0])
    return Reference(time, origin + amplitude * np.sin(phase), amplitude * frequency * np.cos(phase))


def rigid_torque(robot: Robot, recording: Recording) -> np.ndarray:
    tree = robot.leg_tree("RH")
    return inverse_dynamics(robot, tree, recording.position, recording.velocity, recording.acceleration)


@pytest.fixture(scope="module")
def hyq() -> Robot:
    return load_robot("hyq")


def with_dynamics(robot: Robot, dynamics: JointDynamics) -> Robot:
    return replace(robot, dynamics=dict.fromkeys(robot.tree.joints, dynamics))


def test_effort_is_pinocchios_inverse_dynamics(hyq: Robot) -> None:
    robot = with_dynamics(hyq, JointDynamics(armature=0.02))
    recording = simulate_leg(robot, "RH", sinusoids())
    assert recording.joints == robot.leg("RH").joints
    np.testing.assert_allclose(recording.effort, rigid_torque(robot, recording), atol=1e-9)


def test_effort_of_a_leg_with_negative_moments(hyq: Robot) -> None:
    truth = perturbed(hyq, "RH", np.random.default_rng(7))
    assert not all(truth.inertias[link].is_physical() for link in truth.leg("RH").links)
    truth = with_dynamics(truth, JointDynamics())
    recording = simulate_leg(truth, "RH", sinusoids(1.0))
    np.testing.assert_allclose(recording.effort, rigid_torque(truth, recording), atol=1e-9)


def test_effort_pays_for_friction_and_offset(hyq: Robot) -> None:
    robot = with_dynamics(hyq, FRICTION)
    recording = simulate_leg(robot, "RH", sinusoids())
    rest = recording.effort - rigid_torque(robot, recording) - FRICTION.viscous * recording.velocity - FRICTION.offset
    slides = np.abs(recording.velocity) > 0.05
    np.testing.assert_allclose(rest[slides], FRICTION.coulomb * np.sign(recording.velocity[slides]), atol=1e-9)
    assert np.abs(rest).max() <= FRICTION.coulomb + 1e-9
    assert slides.mean() > 0.8


def test_channels_are_derivatives_of_each_other(hyq: Robot) -> None:
    recording = simulate_leg(with_dynamics(hyq, JointDynamics()), "RH", sinusoids())
    settled = slice(1000, -1)
    velocity = np.gradient(recording.position, recording.time, axis=0)
    acceleration = np.gradient(recording.velocity, recording.time, axis=0)
    np.testing.assert_allclose(recording.velocity[settled], velocity[settled], atol=1e-4)
    np.testing.assert_allclose(recording.acceleration[settled], acceleration[settled], atol=1e-2)


def test_straight_legs_of_a_humanoid_follow_their_own_acceleration() -> None:
    """About the long axis of a straight leg there is little inertia, and the drives' damping is fast."""
    robot = load_robot("h1")
    robot = replace(robot, dynamics=dict.fromkeys(robot.tree.joints, JointDynamics()))
    time = np.arange(300) / 1000.0
    turn, speed = 0.1 * np.sin(12.0 * time), 1.2 * np.cos(12.0 * time)
    ones = np.ones(len(robot.leg("left").joints))
    recording = simulate_leg(robot, "left", Reference(time, np.outer(turn, ones), np.outer(speed, ones)))
    acceleration = np.gradient(recording.velocity, time, axis=0)
    np.testing.assert_allclose(recording.acceleration[50:-1], acceleration[50:-1], atol=0.5)


def test_energy_balance(hyq: Robot) -> None:
    """Work of the motors = change of kinetic and potential energy, by Pinocchio's energies."""
    import pinocchio as pin

    from lab.plant.reference import pinocchio_model

    robot = with_dynamics(hyq, JointDynamics())
    recording = simulate_leg(robot, "RH", sinusoids(2.0))
    power = (recording.effort * recording.velocity).sum(axis=1)
    work = np.r_[0.0, np.cumsum(0.5 * (power[1:] + power[:-1]) * np.diff(recording.time))]
    model = pinocchio_model(robot, robot.leg_tree("RH"))
    data = model.createData()
    energy = np.array(
        [
            pin.computeMechanicalEnergy(model, data, q, v)
            for q, v in zip(recording.position, recording.velocity, strict=True)
        ]
    )
    np.testing.assert_allclose(work, energy - energy[0], atol=2e-4 * np.ptp(energy))


def test_tracks_the_reference(hyq: Robot) -> None:
    reference = sinusoids()
    recording = simulate_leg(hyq, "RH", reference)
    np.testing.assert_allclose(recording.time, reference.time)
    assert np.abs(recording.position - reference.position).max() < 0.1


def test_slow_clock_is_integrated_at_a_millisecond(hyq: Robot) -> None:
    robot = with_dynamics(hyq, JointDynamics())
    fine, coarse = simulate_leg(robot, "RH", sinusoids(1.0)), simulate_leg(robot, "RH", sinusoids(1.0, 200.0))
    np.testing.assert_allclose(coarse.position, fine.position[::5], atol=1e-3)
    np.testing.assert_allclose(coarse.effort, rigid_torque(robot, coarse), atol=1e-9)


def test_effort_saturates_at_the_limit(hyq: Robot) -> None:
    limits = {joint: JointLimits(effort=2.0) for joint in hyq.tree.joints}
    robot = with_dynamics(replace(hyq, limits=limits), JointDynamics())
    recording = simulate_leg(robot, "RH", sinusoids(1.0))
    assert np.abs(recording.effort).max() == 2.0
    np.testing.assert_allclose(recording.effort, rigid_torque(robot, recording), atol=1e-9)


def test_a_motion_that_runs_away_is_named(hyq: Robot) -> None:
    limits = {joint: JointLimits() for joint in hyq.tree.joints}
    gains = Gains(np.full(3, 1e7), np.full(3, 1e7))
    with pytest.raises(ModelError, match="ran away at"):
        simulate_leg(replace(hyq, limits=limits), "RH", sinusoids(1.0), gains=gains)
