"""Cutting recordings in time and putting them together again."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from stadera.errors import RecordingError
from stadera.recording.recording import Array, Imu, Recording

Rows = slice | NDArray[np.bool_] | NDArray[np.int64]


def take(recording: Recording, rows: Rows) -> Recording:
    """The samples that `rows` (slice, mask or increasing indices) picks, of everything recorded."""

    def rows_of(values: Array | None) -> Array | None:
        return None if values is None else values[rows]

    imu = recording.imu
    return replace(
        recording,
        time=recording.time[rows],
        position=recording.position[rows],
        velocity=rows_of(recording.velocity),
        acceleration=rows_of(recording.acceleration),
        effort=rows_of(recording.effort),
        imu=imu and Imu(imu.angular_velocity[rows], imu.linear_acceleration[rows], rows_of(imu.orientation), imu.frame),
        foot_force={foot: force[rows] for foot, force in recording.foot_force.items()},
        foot_contact={foot: contact[rows] for foot, contact in recording.foot_contact.items()},
    )


def concatenate(recordings: Sequence[Recording]) -> Recording:
    """One recording of consecutive ones that hold the same things; notes are put one after the other.

    Raises:
        RecordingError: none given, joints or channels that differ, time that does not increase.
    """
    if not recordings:
        raise RecordingError("nothing to concatenate")
    first = recordings[0]
    if len(recordings) == 1:
        return first
    if any(_contents(other) != _contents(first) for other in recordings):
        raise RecordingError(f"{first.source}: parts that hold different joints or channels cannot be concatenated")

    def joined(channel: str) -> Array | None:
        if getattr(first, channel) is None:
            return None
        return np.concatenate([getattr(part, channel) for part in recordings])

    imus = [part.imu for part in recordings if part.imu is not None]
    return replace(
        first,
        time=np.concatenate([part.time for part in recordings]),
        position=np.concatenate([part.position for part in recordings]),
        velocity=joined("velocity"),
        acceleration=joined("acceleration"),
        effort=joined("effort"),
        imu=_joined_imu(imus) if imus else None,
        foot_force={f: np.concatenate([part.foot_force[f] for part in recordings]) for f in first.foot_force},
        foot_contact={f: np.concatenate([part.foot_contact[f] for part in recordings]) for f in first.foot_contact},
        notes=tuple(dict.fromkeys(note for part in recordings for note in part.notes)),
    )


def _joined_imu(imus: Sequence[Imu]) -> Imu:
    orientations = [imu.orientation for imu in imus if imu.orientation is not None]
    return Imu(
        angular_velocity=np.concatenate([imu.angular_velocity for imu in imus]),
        linear_acceleration=np.concatenate([imu.linear_acceleration for imu in imus]),
        orientation=np.concatenate(orientations) if orientations else None,
        frame=imus[0].frame,
    )


def _contents(recording: Recording) -> tuple[object, ...]:
    imu = recording.imu
    channels = tuple(getattr(recording, c) is None for c in ("velocity", "acceleration", "effort"))
    feet = tuple(recording.foot_force), tuple(recording.foot_contact)
    return recording.joints, channels, imu is None, imu is not None and imu.orientation is None, feet
