"""Gears give way by the torque that they carry to the link, not by what the motor spends on friction and its rotor."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin

from lab.reality.test_real_draw import EXACT
from stadera.inertia import skew
from stadera.lab.laws.paper_draw import paper_draw
from stadera.lab.pinocchio import pinocchio_model
from stadera.lab.plant.leg import Gains, simulate_leg
from stadera.lab.plant.plant import Plant
from stadera.lab.reality.draw import DrawnRobot, drawn
from stadera.lab.reality.log import TrueMotion, measured_log
from stadera.robot import load_robot
from stadera.robot.stance import standing_configuration
from stadera.types import Array

GO2 = load_robot("go2")
HARMONIC = replace(EXACT, coulomb=(0.03, 0.08))
COMPLIANCE = np.linspace(1e-4, 1e-3, 12)  # [rad/(N·m)]


def elastic(seed: int) -> DrawnRobot:
    return replace(drawn(GO2, HARMONIC, seed), compliance=COMPLIANCE)


def test_the_encoder_is_ahead_by_the_links_inverse_dynamics() -> None:
    """Pinocchio's, without rotors, of a robot with friction and rotors that is pushed about on the ground."""
    draw = elastic(1)
    plant, rng = Plant(draw.robot, draw.terrain), np.random.default_rng(0)
    plant.reset(standing_configuration(GO2))
    limit = np.array([GO2.limits[joint].effort for joint in GO2.tree.joints])
    states = []
    for _ in range(60):
        plant.step(0.5 * limit * rng.uniform(-1.0, 1.0, 12))
        states.append(plant.state)
    log = measured_log(TrueMotion.of(states, GO2), GO2, draw, 0, 1000.0)
    model = pinocchio_model(draw.robot)
    model.armature[:] = 0.0
    data, loads = model.createData(), []
    for s in states:
        R = s.rotation
        q = np.r_[s.position, s.orientation, s.joint_position]
        v = np.r_[R.T @ s.linear_velocity, s.angular_velocity, s.joint_velocity]
        a = np.r_[R.T @ s.linear_acceleration - np.cross(s.angular_velocity, v[:3]), s.angular_acceleration]
        load = np.array(pin.rnea(model, data, q, v, np.r_[a, s.joint_acceleration]))
        pin.computeJointJacobians(model, data, q)
        for k in np.flatnonzero(s.foot_contact):
            joint = model.getJointId(GO2.legs[k].joints[2])
            J = pin.getJointJacobian(model, data, joint, pin.LOCAL_WORLD_ALIGNED)
            load -= (J[:3] - skew(s.contact_point[k] - data.oMi[joint].translation) @ J[3:]).T @ s.foot_force[k]
        loads.append(load[6:])
    given_way = log.position - np.array([s.joint_position for s in states])
    np.testing.assert_allclose(given_way, COMPLIANCE * loads, atol=1e-7)
    spent = np.array([s.effort for s in states]) - loads
    assert np.abs(spent).max() > 1.0, "friction and rotors take a share of the motors' torques"


def test_a_joint_that_turns_round_moves_the_torque_and_not_the_gear() -> None:
    """Legs in the air: while a joint turns round, the motor's torque goes through twice the friction."""
    draw = elastic(2)
    leg = GO2.legs[0]
    motion = paper_draw(GO2, leg.name, np.random.default_rng(3), 8.0).sample(1000.0)
    swung = simulate_leg(draw.robot, leg.name, motion, gains=Gains.scaled(GO2, leg.name))
    log = measured_log(TrueMotion.held(swung, draw.robot), GO2, draw, 0, 1000.0)
    own = [GO2.tree.joints.index(joint) for joint in leg.joints]
    load = (log.position - swung.position) / COMPLIANCE[own]
    assert swung.velocity is not None
    assert swung.effort is not None
    turns = 0
    for k, joint in enumerate(leg.joints):
        slow = np.flatnonzero(np.abs(swung.velocity[:, k]) < 0.02)
        for part in np.split(slow, np.flatnonzero(np.diff(slow) > 1) + 1):
            if np.ptp(np.sign(swung.velocity[part, k])) == 2.0 and part[0] > 0 and part[-1] < len(log) - 1:
                coulomb, turns = draw.robot.dynamics[joint].coulomb, turns + 1
                assert np.ptp(swung.effort[part, k]) > coulomb
                assert np.ptp(load[part, k]) < 0.25 * coulomb
    assert turns > 10


def test_at_rest_gears_give_way_by_the_load_over_their_stiffness() -> None:
    """A robot that stands, held by friction too: f at the feet and the links' weights, by virtual work."""
    draw, plant = elastic(4), Plant(elastic(4).robot)
    plant.reset(standing_configuration(GO2))
    hold, states = plant.joint_position, []
    for _ in range(1500):
        plant.step(300.0 * (hold - plant.joint_position) - 3.0 * plant.joint_velocity)
        states.append(plant.state)
    s = states[-1]
    assert np.abs(s.joint_velocity).max() < 1e-3
    log = measured_log(TrueMotion.of(states[-3:], GO2), GO2, draw, 0, 1000.0)
    model = pinocchio_model(draw.robot)
    data, q = model.createData(), np.r_[s.position, s.orientation, s.joint_position]

    def energy(q: Array) -> float:
        """Of the links' weights and of the feet's forces, which act at points fixed to the calves [J]."""
        pin.forwardKinematics(model, data, q)
        places = [data.oMi[model.getJointId(leg.joints[2])].act(p) for leg, p in zip(GO2.legs, points, strict=True)]
        work = sum(f @ p for f, p in zip(s.foot_force, places, strict=True))
        return float(pin.computePotentialEnergy(model, data, q) - work)

    pin.forwardKinematics(model, data, q)
    at = zip(GO2.legs, s.contact_point, strict=True)
    points = [data.oMi[model.getJointId(leg.joints[2])].actInv(point) for leg, point in at]
    steps = 1e-5 * np.eye(19)[7:]
    loads = np.array([(energy(q + step) - energy(q - step)) / 2e-5 for step in steps])
    np.testing.assert_allclose(log.position[-1] - s.joint_position, COMPLIANCE * loads, atol=2e-6)
    assert np.abs(s.effort - loads).max() > 0.1, "friction carries some"
