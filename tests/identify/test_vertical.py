"""The vertical of a held trunk from its IMU."""

from __future__ import annotations

import numpy as np
import pytest

from stadera.errors import ModelError
from stadera.identify.job import vertical_of
from stadera.logs.recording import Imu, Recording
from stadera.robot import load_robot


def _recording(frame):
    imu = Imu(np.zeros((4, 3)), np.tile([0.0, 4.0, 8.0], (4, 1)), frame=frame)
    return Recording(np.arange(4.0), (), np.zeros((4, 0)), imu=imu)


def test_an_imu_in_the_trunk_frame_needs_no_rotation():
    robot = load_robot("hyq")
    vertical = vertical_of(_recording(robot.trunk), robot, None)
    np.testing.assert_allclose(vertical.up, [0.0, 4.0, 8.0])
    assert vertical.turning == 0.0


def test_an_imu_on_a_leg_is_refused():
    robot = load_robot("hyq")
    on_leg = next((name for name, frame in robot.frames.items() if frame.link != robot.trunk), None)
    if on_leg is None:
        pytest.skip("the robot has no frame on a leg")
    with pytest.raises(ModelError, match=on_leg):
        vertical_of(_recording(on_leg), robot, None)
