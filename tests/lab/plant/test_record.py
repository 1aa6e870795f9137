"""Runs as recordings: sensors and truth stay apart."""

from __future__ import annotations

import numpy as np
import pytest

from stadera.errors import RecordingError
from stadera.lab.plant.plant import Plant
from stadera.lab.plant.sensors import STANDARD, Sensors, recording_of, truth_of
from stadera.robot import load_robot
from stadera.robot.stance import standing_configuration


def test_sensors_and_truth_are_two_recordings_of_one_run() -> None:
    robot = load_robot("hyq")
    plant, sensors = Plant(robot), Sensors(STANDARD, 0, robot)
    plant.reset(standing_configuration(robot))
    samples, states = [], []
    for _ in range(50):
        plant.step(np.zeros(12))
        samples.append(sensors.read(plant))
        states.append(plant.state)
    said, true = recording_of(samples, robot), truth_of(states, robot)
    np.testing.assert_allclose(said.time, 1e-3 * np.arange(1, 51), atol=1e-12)
    np.testing.assert_array_equal(said.time, true.time)
    assert said.acceleration is None
    assert not said.foot_force
    assert not said.foot_contact
    assert said.imu is not None
    assert said.imu.frame == "trunk_imu"
    assert 0 < np.abs(said.position - true.position).max() < 8 * STANDARD.position
    assert set(true.foot_force) == {leg.foot for leg in robot.legs}
    np.testing.assert_array_equal(true.foot_force["rh_foot"][-1], states[-1].foot_force[3])
    assert true.acceleration is not None
    with pytest.raises(RecordingError, match="stands still"):
        recording_of([samples[0], samples[0]], robot)
