"""Blocks of a log whose rate does not divide into them: some have a single sample."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from stadera.lab.scenarios.catalog import SimulateSettings
from stadera.lab.scenarios.run import simulate
from stadera.robot import load_robot
from stadera.trunk import TrunkEstimator
from stadera.trunk.samples import Samples


@cache
def made() -> Samples:
    robot = load_robot("go2")
    run = simulate(robot, "shake", SimulateSettings("standard", duration=3.0, seed=1, rate=250.0, hold=2))
    return Samples.of_recording(run.recording, robot)


@pytest.mark.parametrize("every", [3, 6])
def test_slow_logs_are_weighed(every: int) -> None:
    robot, samples = load_robot("go2"), made()
    estimator = TrunkEstimator(robot)
    estimator.add(samples[np.arange(len(samples)) % every == 0])
    assert estimator.trunk.inertial.mass == pytest.approx(robot.inertias[robot.trunk].mass, abs=0.1 * robot.mass)
