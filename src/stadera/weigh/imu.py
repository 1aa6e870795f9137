"""Logs without an IMU: which they are, what weighs by them, and what to say where nothing does.

Joints alone weigh a robot that stands still, by the direction of what its feet carry (`stadera.estimate.vertical`);
motion is told from weight by an IMU alone.
"""

from __future__ import annotations

from math import degrees

import numpy as np
from numpy.typing import NDArray

from stadera.errors import RecordingError
from stadera.estimate.equilibrium import ConstantErrors, weight_felt
from stadera.estimate.forces import ContactForceEstimator
from stadera.estimate.pose_means import PoseMean
from stadera.estimate.registry import METHODS
from stadera.inertia import skew
from stadera.recording import LogFile, stream
from stadera.robot.model import Robot
from stadera.weigh.result import Vertical
from stadera.weigh.settings import WeighSettings

Array = NDArray[np.float64]

WITH_IMU, WITHOUT_IMU = "contact", "poses"
"""Methods for whom no method is asked for."""

_ENOUGH = 2  # samples to see what is recorded


def has_imu(log: LogFile, robot: Robot) -> bool:
    """Whether a log has gyro and accelerometer.

    Raises:
        RecordingError: it cannot be read, or lacks one of the robot's joints.
    """
    chunk = next(stream(log, joints=robot.tree.joints, rows=_ENOUGH), None)
    return chunk is not None and chunk.imu is not None


def require_imu(log: LogFile, robot: Robot, method: str) -> None:
    """Makes sure that a log has what a method needs.

    Raises:
        RecordingError: it has no IMU; names what lacks, and what weighs without it.
    """
    try:
        stream(log, joints=robot.tree.joints, require=("imu",))
    except RecordingError as error:
        if has_imu(log, robot):
            raise
        others = " or ".join(f"--method {name}" for name, other in METHODS.items() if not other.needs_imu)
        raise RecordingError(
            f"{error}; the method {method!r} needs an IMU; without one nothing is told of a robot that moves, and "
            f"while it stands still {others} weighs it, by the direction of its feet's forces"
        ) from None


def method_for(log: LogFile, robot: Robot, settings: WeighSettings) -> str:
    """The method to weigh a log by.

    Raises:
        RecordingError: the log has no IMU, and the method needs one, or the settings say which.
    """
    if has_imu(log, robot):
        return settings.method or WITH_IMU
    method = settings.method or WITHOUT_IMU
    if METHODS[method].needs_imu:
        require_imu(log, robot, method)
    for option, asked in (("--imu-topic", log.topics.imu), ("--imu-frame", settings.imu_frame)):
        if asked is not None:
            raise RecordingError(f"{log}: {option} {asked}: the log has no IMU that can be used")
    return method


def vertical_at(pose: PoseMean, forces: ContactForceEstimator, errors: ConstantErrors) -> Vertical:
    """The vertical in a pose at rest, and what constant errors and white noise leave of it."""
    m = pose.measurement
    if not m.vertical_by_forces:
        turned = skew(m.up)
        return Vertical("imu", m.up, _sizes(turned @ errors.covariance[24:27, 24:27] @ turned.T))
    found = forces.at(m)
    felt = weight_felt(found, forces.robot, m.joint_position, m.up)[1:]
    white = felt[:, :12] * (found.noise.torque_white.ravel() ** 2 / pose.count) @ felt[:, :12].T
    return Vertical("forces", m.up, _sizes(felt @ errors.covariance @ felt.T + white))


def without_imu_note(vertical: Vertical) -> str:
    """What is and what is not known of a log without an IMU, one sentence."""
    return (
        "no IMU: weighed while the joints stand still, by the direction of the feet's forces for the vertical, known "
        f"to ±{degrees(vertical.tilt_std):.2g}°, which is in the error bars; a steady push or pull and a floor that "
        "accelerates would be taken for weight, and inertia and whatever the robot does in motion are not known"
    )


def _sizes(covariance: Array) -> Array:
    return np.sqrt(np.diag(covariance))
