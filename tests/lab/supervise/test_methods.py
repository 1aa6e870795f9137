"""Weighing a standing robot by static poses."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from stadera.lab.laws.equilibrium import NoisyForces
from stadera.lab.laws.static_poses import PoseOffset, standing_still
from stadera.lab.supervise.weighing import Stage, StandingWeighing
from stadera.robot import load_robot
from stadera.trunk import TrunkModel

HYQ = load_robot("hyq")
PERIOD = 0.01


def test_static_poses_are_led_through_and_left_again():
    asked: list[PoseOffset] = []
    # what is believed at first is wrong, the height too
    prior = TrunkModel.prior(HYQ)
    wrong = TrunkModel(prior.mass, prior.com_trunk + np.array([0.03, -0.02, 0.05]))
    forces = NoisyForces(HYQ)
    weighing = StandingWeighing(forces, wrong, 0.0, lean=lambda pose, duration: asked.append(pose))
    poses = {0: standing_still(HYQ, PoseOffset())}
    for k in range(2000):
        if len(asked) not in poses:
            poses[len(asked)] = standing_still(HYQ, asked[-1])
        pose = poses[len(asked)]
        assert pose is not None
        weighing.update(replace(pose, time=(k + 1) * PERIOD))
        if weighing.stage is Stage.DONE:
            break
    assert weighing.stage is Stage.DONE
    assert len(asked) == 6
    assert not asked[-1].turn.any(), "back to where it stood"
    assert weighing.estimate is not None
    assert weighing.estimate.trunk.com_trunk == pytest.approx(prior.com_trunk, abs=1e-4), "height and all"
