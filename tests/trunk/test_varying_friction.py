"""Static friction of a robot at rest."""

from __future__ import annotations

from stadera.lab.scenarios.catalog import SimulateSettings
from stadera.lab.scenarios.run import simulate
from stadera.robot import load_robot
from stadera.trunk import Samples, TrunkEstimator


def test_a_robot_at_rest_on_joints_that_stick_shows_no_height() -> None:
    robot = load_robot("hyq")
    for seed in (501, 502):
        log = simulate(robot, "stand", SimulateSettings("real-unit-gain", duration=4.0, seed=seed, hold=2)).recording
        estimator = TrunkEstimator(robot)
        estimator.add(Samples.of_recording(log, robot))
        assert estimator.trunk.observed[:3].all()
        assert not estimator.trunk.observed[3]
