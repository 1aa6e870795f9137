"""Changes applied to a log while it is read: corrections of faults, and conversion of motor torques to joint
torques.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import isfinite
from typing import Self

import numpy as np

from stadera.constants import GRAVITY
from stadera.errors import RecordingError
from stadera.joint_words import by_part
from stadera.logs.columns import CHANNELS
from stadera.logs.recording import Recording
from stadera.types import Array

GYRO, ACCELEROMETER = "gyro", "accelerometer"


@dataclass(frozen=True)
class Mend:
    """One correction; fields at their defaults change nothing."""

    text: str  # description for a note
    # by quantity ("time", a channel of the joints, "gyro", "accelerometer")
    factors: Mapping[str, float] = field(default_factory=dict)
    joint_factors: Mapping[tuple[str, str], float] = field(default_factory=dict)  # factors by channel and joint
    # by channel and joint, the joint whose columns contain the values
    swapped: Mapping[tuple[str, str], str] = field(default_factory=dict)
    # rows of the rotation that takes the IMU's values to the right axes
    turn: tuple[tuple[float, float, float], ...] = ()
    gyro_alone: bool = False  # the turn is that of the gyro, not of the accelerometer
    gravity: bool = False  # add gravity to the specific force, according to the IMU's orientation

    def sources(self, joints: Iterable[str]) -> tuple[str, ...]:
        """Joints whose columns are needed for these joints' values."""
        needed = dict.fromkeys(joints)
        others = [source for (_, joint), source in self.swapped.items() if joint in needed]
        return tuple(needed | dict.fromkeys(others))

    def __call__(self, recording: Recording) -> Recording:
        """Returns the corrected recording, which must contain the joints whose columns are swapped."""
        imu, others = recording.imu, recording.others

        def corrected(name: str, values: Array) -> Array:
            quantity = name.removeprefix("others.")
            if name == "imu.angular_velocity":
                return self.of_imu(GYRO, values)
            if name == "imu.linear_acceleration":
                if self.gravity and imu is not None and imu.orientation is not None:
                    values = values + GRAVITY * upwards(imu.orientation)
                return self.of_imu(ACCELEROMETER, values)
            values = values * self.factors[quantity] if quantity in self.factors else values
            joints = recording.joints if others is None or quantity == name else others.names
            return self.of_joints(quantity, values, joints) if quantity in CHANNELS else values

        made = recording.mapped(corrected)
        if made.imu is None or not self.turn or self.gyro_alone:
            return made
        return replace(made, imu=replace(made.imu, orientation=None))  # its frame is not that of the values

    def of_joints(self, channel: str, values: Array, joints: Sequence[str]) -> Array:
        order = [joints.index(self.swapped.get((channel, joint), joint)) for joint in joints]
        factor = np.array([self.joint_factors.get((channel, joint), 1.0) for joint in joints])
        return np.asarray(values[:, order] * factor)

    def of_imu(self, quantity: str, values: Array) -> Array:
        """Corrected values (samples, 3) of a gyro or accelerometer."""
        if self.turn and not (self.gyro_alone and quantity != GYRO):
            values = values @ np.array(self.turn).T
        return self.factors[quantity] * values if quantity in self.factors else values


GEARED = "torques are the motors', times gear ratios"
"""How the note on a gear begins."""


@dataclass(frozen=True)
class Gear:
    """Gear ratios for torques of motors: a joint's torque is the motor's times the ratio. One or three, above 0, else
    RecordingError.
    """

    # one for all joints, or one each for hip, thigh and calf (HAA, HFE, KFE), including the joint's lever
    ratios: tuple[float, ...]

    def __post_init__(self) -> None:
        if len(self.ratios) not in (1, 3) or not all(isfinite(ratio) and ratio > 0 for ratio in self.ratios):
            raise RecordingError(f"gear ratios are one or three, for hip, thigh and calf, above 0: got {self.ratios}")

    @classmethod
    def parse(cls, text: str) -> Self:
        """Parses ratios from "6.33" or "6.33,6.33,9.55". Raises RecordingError: another format."""
        try:
            return cls(tuple(float(part) for part in text.split(",")))
        except ValueError:
            raise RecordingError(f"{text!r} is no gear ratio, nor three with commas for hip, thigh and calf") from None

    @property
    def text(self) -> str:
        """Description for a note."""
        return f"{GEARED} of {', '.join(f'{ratio:g}' for ratio in self.ratios)}"

    def sources(self, joints: Iterable[str]) -> tuple[str, ...]:
        """The joints themselves."""
        return tuple(joints)

    def __call__(self, recording: Recording) -> Recording:
        """Returns the recording with torques of the joints. Raises as `by_part`."""
        if recording.effort is None:
            return recording
        ratios = by_part(self.ratios, recording.joints, "one gear ratio")
        return replace(recording, effort=recording.effort * np.array(ratios))


Change = Mend | Gear
"""Change applied to recordings while a log is read."""


AS_RECORDED = Mend("")
"""Changes nothing."""


def changed(
    recording: Recording, changes: Sequence[Change], joints: Sequence[str] | None = None, *, first: bool = True
) -> Recording:
    """A recording after all changes, in order, with notes on them if it is a log's first; for these joints, None for
    all.
    """
    for change in changes:
        recording = change(recording)
    if first:
        recording = replace(recording, notes=(*recording.notes, *(change.text for change in changes)))
    return recording if joints is None else recording.of_joints(joints)


def sources_of(changes: Sequence[Change], joints: Sequence[str] | None) -> tuple[str, ...] | None:
    """The joints to read to obtain these after all changes; None for all."""
    if joints is None:
        return None
    found = tuple(joints)
    for change in reversed(changes):
        found = change.sources(found)
    return found


def upwards(xyzw: Array) -> Array:
    """The world's z axis in the body's axes, (samples, 3), from nonzero orientations."""
    x, y, z, w = (xyzw / np.linalg.norm(xyzw, axis=1, keepdims=True)).T
    return np.column_stack([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)])
