"""Weighing by approaches (a) and (b) under the supervisor."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from stadera.lab.control import TestBed, TrunkController
from stadera.lab.control.walkers import StandingWalker
from stadera.lab.laws.static_poses import PoseOffset, standing_still
from stadera.lab.plant import IDEAL, Plant, RigidMass, Sensors
from stadera.lab.supervise import PosingWalker, State, SuperviseSettings, Supervisor
from stadera.robot import load_robot
from stadera.robot.stance import standing_configuration
from stadera.trunk import ContactForceEstimator, TrunkModel
from stadera.trunk.posture import PostureLaw

HYQ = load_robot("hyq")
PERIOD = 0.01


class LeaningWalker:
    """Stands, and is at once where it is asked to lean."""

    phase, stopped, fault = "standing", True, ""

    def __init__(self) -> None:
        self.asked: list[PoseOffset] = []
        self.models: list[TrunkModel] = []
        self.resumed = False

    def request_stop(self) -> None: ...

    def resume(self) -> None:
        self.resumed = True

    def sit(self) -> None: ...

    def update_trunk(self, trunk: TrunkModel) -> bool:
        self.models.append(trunk)
        return True

    def posture(self) -> PostureLaw:
        return PostureLaw(np.full(3, 1e3), np.eye(3))

    def lean(self, pose: PoseOffset, duration: float) -> None:
        self.asked.append(pose)


def test_static_poses_are_led_through_and_left_again():
    walker = LeaningWalker()
    assert isinstance(walker, PosingWalker)
    # what is believed at first is wrong, the height too
    prior = TrunkModel.prior(HYQ)
    wrong = TrunkModel(prior.mass, prior.com_trunk + np.array([0.03, -0.02, 0.05]))
    supervisor = Supervisor(HYQ, walker, wrong, settings=SuperviseSettings(method="poses", period=PERIOD))
    supervisor.weigh("to be sure")
    poses = {0: standing_still(HYQ, PoseOffset())}
    for k in range(2000):
        count = len(walker.asked)
        if count not in poses:
            poses[count] = standing_still(HYQ, walker.asked[-1])
        pose = poses[count]
        assert pose is not None
        supervisor.update(replace(pose, time=(k + 1) * PERIOD))
        if walker.resumed:
            break
    assert supervisor.state is State.WALKING
    assert len(walker.asked) == 6
    assert not walker.asked[-1].turn.any(), "back to where it stood"
    (found,) = walker.models
    assert found.com_trunk == pytest.approx(prior.com_trunk, abs=1e-4), "height and all"


def test_orientation_error_without_touching_the_controllers_trunk():
    plant = Plant(HYQ)
    plant.reset(standing_configuration(HYQ))
    controller = TrunkController(HYQ)
    bed = TestBed(plant, Sensors(IDEAL, 0, HYQ), controller)
    walker, forces = StandingWalker(controller), ContactForceEstimator(HYQ, legs=controller.legs)
    settings = SuperviseSettings(method="orientation", period=PERIOD)
    supervisor = Supervisor(HYQ, walker, forces=forces, settings=settings)
    bed.run(0.3)
    plant.apply_payload(RigidMass.box(8.0, (0.1, 0.1, 0.1), (-0.2, 0.1, 0.2)))
    supervisor.weigh("a load was put on")
    believed = []

    def watch(bed: TestBed) -> None:
        assert bed.measurement is not None
        supervisor.update(bed.measurement)
        if supervisor.weighing:
            believed.append(controller.trunk.mass)

    while not walker.resumed and plant.time < 8.0:
        bed.run(0.1, watch)
    assert walker.resumed == 1
    assert set(believed) == {HYQ.inertias[HYQ.trunk].mass}, "the old one until there is a whole new one"
    truth = plant.truth()
    assert supervisor.trunk.mass == pytest.approx(truth.mass, abs=0.05)
    assert supervisor.trunk.com_trunk[:2] == pytest.approx(truth.com[:2], abs=3e-3)
