"""Runs of the test-bed as recordings: what the sensors said, and, apart from it, what was true."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from stadera.recording import Imu, Recording
from stadera.robot.model import Robot
from stadera.sim.sensors import Sample
from stadera.sim.state import TrueState
from stadera.sim.world import default_imu_frame

Array = NDArray[np.float64]


def recording_of(samples: Sequence[Sample], robot: Robot, source: str = "simulation") -> Recording:
    """What the sensors said, as a log of the robot would hold it: joints and IMU, neither feet nor truth.

    Raises:
        RecordingError: times that do not increase.
    """
    return Recording(
        time=np.array([sample.time for sample in samples]),
        joints=robot.tree.joints,
        position=_stacked([sample.joint_position for sample in samples]),
        velocity=_stacked([sample.joint_velocity for sample in samples]),
        effort=_stacked([sample.effort for sample in samples]),
        imu=Imu(
            angular_velocity=_stacked([sample.angular_velocity for sample in samples]),
            linear_acceleration=_stacked([sample.specific_force for sample in samples]),
            orientation=_stacked([sample.orientation for sample in samples]),
            frame=default_imu_frame(robot),
        ),
        source=source,
    )


def truth_of(states: Sequence[TrueState], robot: Robot, source: str = "simulation's truth") -> Recording:
    """What was true: joint motion with accelerations, efforts, and the ground's forces on the feet in world axes.

    Raises:
        RecordingError: times that do not increase.
    """
    forces, contacts = _stacked([s.foot_force for s in states]), np.array([s.foot_contact for s in states])
    feet = [leg.foot for leg in robot.legs]
    return Recording(
        time=np.array([state.time for state in states]),
        joints=robot.tree.joints,
        position=_stacked([state.joint_position for state in states]),
        velocity=_stacked([state.joint_velocity for state in states]),
        acceleration=_stacked([state.joint_acceleration for state in states]),
        effort=_stacked([state.effort for state in states]),
        foot_force={foot: np.ascontiguousarray(forces[:, k]) for k, foot in enumerate(feet)},
        foot_contact={foot: np.ascontiguousarray(contacts[:, k]) for k, foot in enumerate(feet)},
        source=source,
    )


def _stacked(rows: list[Array]) -> Array:
    return np.array(rows, dtype=float)
