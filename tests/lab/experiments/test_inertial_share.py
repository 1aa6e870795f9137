"""The split of joint torques against Pinocchio's inverse dynamics, and at rest."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from stadera.inertia import skew
from stadera.lab.control.crawl import Crawl
from stadera.lab.control.stand import TestBed
from stadera.lab.control.steps import CrawlCommand
from stadera.lab.control.trunk import TrunkController
from stadera.lab.experiments.inertial_share import InertialTorques
from stadera.lab.pinocchio import pinocchio_model
from stadera.lab.plant.plant import Plant
from stadera.lab.plant.sensors import IDEAL, Sensors
from stadera.robot import load_robot
from stadera.robot.stance import standing_configuration


def test_inertial_torques_are_those_of_inverse_dynamics_without_gravity() -> None:
    robot = load_robot("hyq")
    plant = Plant(robot)
    plant.reset(standing_configuration(robot))
    crawl = Crawl(TrunkController(robot), command=CrawlCommand(0.15))
    bed, split = TestBed(plant, Sensors(IDEAL, 0, robot), crawl), InertialTorques(robot)
    bed.run(0.5)
    assert np.linalg.norm(split.of(plant.state)) < 0.02 * np.linalg.norm(plant.effort)  # it still stands
    crawl.resume()
    model = pinocchio_model(robot)
    model.gravity = pin.Motion.Zero()
    data = model.createData()
    columns = [[robot.tree.joints.index(joint) for joint in leg.joints] for leg in robot.legs]
    for _ in range(8):
        bed.run(0.21)
        s, R = plant.state, plant.state.rotation
        q = np.r_[s.position, s.orientation, s.joint_position]
        v = np.r_[R.T @ s.linear_velocity, s.angular_velocity, s.joint_velocity]
        a = np.r_[R.T @ s.linear_acceleration - np.cross(s.angular_velocity, v[:3]), s.angular_acceleration]
        needed = pin.rnea(model, data, q, v, np.r_[a, s.joint_acceleration])
        pin.computeJointJacobians(model, data, q)
        rows = []
        for k in np.flatnonzero(s.foot_contact):
            joint = model.getJointId(robot.legs[k].joints[2])
            J = pin.getJointJacobian(model, data, joint, pin.LOCAL_WORLD_ALIGNED)
            rows.append(J[:3] - skew(s.contact_point[k] - data.oMi[joint].translation) @ J[3:])
        stacked = np.vstack(rows)
        force = np.linalg.pinv(stacked[:, :6].T) @ needed[:6]  # the least forces that move it so
        expected = (needed - stacked.T @ force)[6:][columns]
        np.testing.assert_allclose(split.of(s), expected, atol=0.02 + 0.002 * np.abs(expected).max())
