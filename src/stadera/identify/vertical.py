"""Determines the vertical for a held trunk, from the IMU if there is one."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stadera.logs.recording import Recording
from stadera.robot.imu import ImuMount
from stadera.robot.model import Robot
from stadera.types import Array


@dataclass(frozen=True, eq=False)
class TrunkUp:
    """The vertical in trunk axes (3,), a sentence on its source, and how fast the trunk turns (rms) [rad/s]."""

    up: Array
    note: str
    turning: float = 0.0


def vertical_of(recording: Recording, robot: Robot, up: tuple[float, float, float] | None) -> TrunkUp:
    """The given vertical, else the mean specific force in a log's IMU, else the trunk's z axis.

    Raises:
        UnknownNameError: the log names an IMU frame that the robot lacks.
        ModelError: that frame is fixed to a leg.
    """
    if up is not None:
        return TrunkUp(np.asarray(up, dtype=float), f"vertical given: ({up[0]:g}, {up[1]:g}, {up[2]:g}) in trunk axes")
    imu = recording.imu
    if imu is None:
        return TrunkUp(np.array([0.0, 0.0, 1.0]), "no IMU in the log and no vertical given: trunk taken as level")
    mean = ImuMount.of(robot, imu.frame).rotation @ imu.linear_acceleration.mean(axis=0)
    turning = float(np.sqrt(np.mean(np.sum(imu.angular_velocity**2, axis=1))))
    tilt = np.degrees(np.arccos(np.clip(mean[2] / np.linalg.norm(mean), -1.0, 1.0)))
    return TrunkUp(mean, f"vertical from the IMU: trunk tilted by {tilt:.1f}°", turning)
