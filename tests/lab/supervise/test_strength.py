"""Whether a robot can carry a load on three legs."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from stadera.lab.supervise.supervisor import hardest_effort
from stadera.robot import load_robot
from stadera.robot.stance import standing_configuration
from stadera.trunk import TrunkModel

HYQ = load_robot("hyq")


def with_mass(mass: float) -> TrunkModel:
    prior = TrunkModel.prior(HYQ)
    return TrunkModel(mass, prior.com_trunk)


def test_torque_is_that_of_pinocchio_with_the_foot_pushed_up():
    """Gravity of the legs, and the vertical force by the rate at which each joint lifts the foot."""
    found = hardest_effort(HYQ, TrunkModel.prior(HYQ))
    model = pin.buildModelFromUrdf(str(HYQ.source))  # the trunk held
    data, q = model.createData(), np.zeros(model.nq)
    for joint, angle in zip(HYQ.tree.joints, standing_configuration(HYQ), strict=True):
        q[model.joints[model.getJointId(joint)].idx_q] = angle
    gravity = pin.computeGeneralizedGravity(model, data, q)
    pin.forwardKinematics(model, data, q)
    pin.updateFramePlacements(model, data)
    feet = {leg.name: data.oMf[model.getFrameId(leg.foot)].translation[:2] for leg in HYQ.legs}
    worst = 0.0
    for leg in HYQ.legs:
        frame = model.getFrameId(leg.foot)
        J = pin.computeFrameJacobian(model, data, q, frame, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED)
        sole = J[2] + np.cross(J[3:].T, [0.0, 0.0, -leg.foot_radius])[:, 2]
        for missing in set(feet) - {leg.name}:
            others = [feet[name] for name in feet if name not in (leg.name, missing)]
            edges = [np.linalg.norm(feet[leg.name] - other) for other in others]
            opposite = np.linalg.norm(others[0] - others[1])
            force = HYQ.mass * 9.81 * opposite / (opposite + sum(edges))
            worst = max(worst, np.abs(gravity - sole * force).max())
    assert found.torque == pytest.approx(worst, rel=1e-6)


def test_heavier_loads_are_harder_until_they_are_too_heavy():
    shares = [hardest_effort(HYQ, with_mass(mass)).share for mass in (61.0, 71.0, 100.0, 300.0)]
    assert shares == sorted(shares)
    assert shares[1] < 1.0 < shares[-1]


def test_it_names_the_joint_and_its_limit():
    found = hardest_effort(HYQ, with_mass(71.0))
    assert found.joint in HYQ.tree.joints
    assert found.limit == HYQ.limits[found.joint].effort
