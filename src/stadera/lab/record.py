"""Converts runs of the test-bed to recordings: the sensors' values and, separately, the truth."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from stadera.lab.plant.state import TrueState
from stadera.lab.sensors import SensorReading
from stadera.logs import Imu, Recording
from stadera.robot.imu import ImuMount
from stadera.robot.model import Robot
from stadera.types import Array


def recording_of(samples: Sequence[SensorReading], robot: Robot, source: str = "simulation") -> Recording:
    """The sensors' values as a log of the robot: joints and IMU, without feet and truth.

    Raises:
        RecordingError: times that do not increase.
    """
    return Recording(
        time=_stacked(samples, "time"),
        joints=robot.tree.joints,
        position=_stacked(samples, "joint_position"),
        velocity=_stacked(samples, "joint_velocity"),
        effort=_stacked(samples, "effort"),
        imu=Imu(
            angular_velocity=_stacked(samples, "angular_velocity"),
            linear_acceleration=_stacked(samples, "specific_force"),
            orientation=_stacked(samples, "orientation"),
            frame=ImuMount.of(robot).name,
        ),
        source=source,
    )


def truth_of(states: Sequence[TrueState], robot: Robot, source: str = "simulation's truth") -> Recording:
    """The truth: joint motion with accelerations, efforts, and the forces of the ground on the feet in world axes.

    Raises:
        RecordingError: times that do not increase.
    """
    forces, contacts = _stacked(states, "foot_force"), np.array([s.foot_contact for s in states])
    feet = [leg.foot for leg in robot.legs]
    return Recording(
        time=_stacked(states, "time"),
        joints=robot.tree.joints,
        position=_stacked(states, "joint_position"),
        velocity=_stacked(states, "joint_velocity"),
        acceleration=_stacked(states, "joint_acceleration"),
        effort=_stacked(states, "effort"),
        foot_force={foot: np.ascontiguousarray(forces[:, k]) for k, foot in enumerate(feet)},
        foot_contact={foot: np.ascontiguousarray(contacts[:, k]) for k, foot in enumerate(feet)},
        source=source,
    )


def _stacked(instants: Sequence[SensorReading] | Sequence[TrueState], name: str) -> Array:
    return np.array([getattr(instant, name) for instant in instants], dtype=float)
