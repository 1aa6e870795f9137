"""A simulated Go2 with drawn errors moves, stops, is loaded, moves again and stops: it is weighed by its motion."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from stadera.excite.sinusoids import Sinusoids
from stadera.excite.trunk.planted import AXES, Planted
from stadera.lab.scenarios.catalog import Load, SimulateSettings
from stadera.lab.scenarios.run import simulate
from stadera.logs import Recording
from stadera.robot import load_robot
from stadera.trunk import Samples, TrunkEstimator, TrunkSettings

LOAD, TARED = 1.6, 5.1


def rolling_and_pitching(seconds: float) -> Recording:
    """Roll and pitch by 11°, with the feet in place."""
    robot = load_robot("go2")
    amplitude, frequency = np.zeros((1, 6, 2)), np.ones((1, 6, 2))
    amplitude[0, :2], frequency[0, :2] = 0.1, [[0.6, 0.97], [0.86, 1.59]]
    start = np.array([0.0, seconds - 0.5])
    path = Sinusoids(AXES, np.zeros(6), np.zeros((1, 6)), amplitude, frequency, np.zeros((1, 6, 2)), start, 0.5)
    planted = Planted.of(robot, path, 100.0)
    return Recording(planted.time, robot.tree.joints, planted.motion.position, source="routine")


def test_what_stands_in_between_is_not_weighed_by_its_friction() -> None:
    robot, motion = load_robot("go2"), rolling_and_pitching(4.0)
    how = SimulateSettings(
        "real-unit-gain", Load(LOAD, "kg", (0.05, 0.0, 0.1)), duration=11.0, seed=3, rate=500.0, hold=2
    )
    run = simulate(robot, "motion", replace(how, motion=motion))
    samples, truth = Samples.of_recording(run.recording, robot), run.truth.moments[-1]

    def weighed(settings: TrunkSettings) -> TrunkEstimator:
        estimator = TrunkEstimator(robot, settings=settings)
        estimator.add(samples[samples.time < TARED])
        assert not estimator.changes
        estimator.tare()
        estimator.add(samples[samples.time >= TARED])
        return estimator

    found = weighed(TrunkSettings())
    payload = found.payload
    assert payload is not None
    assert payload.mass == pytest.approx(LOAD, abs=0.005 * robot.mass)
    assert payload.mass_std < 0.008 * robot.mass
    assert abs(payload.mass - LOAD) < 3.0 * payload.mass_std
    assert truth.payload_com is not None
    assert (np.abs(payload.com - truth.payload_com)[:2] < 0.015).all()
    assert [change.kind for change in found.changes if change.time > TARED + 2.0] == []  # it moves again: no change
    plain = TrunkSettings()
    alike = weighed(replace(plain, outliers=replace(plain.outliers, held=1.0))).payload
    assert alike is not None
    assert alike.mass_std > 2.0 * payload.mass_std  # with friction of rest in the sums
