"""A recording: what a robot's sensors said, as time-major arrays in SI units."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from stadera.errors import RecordingError, UnknownNameError

Array = NDArray[np.float64]

_CHANNELS = ("position", "velocity", "acceleration", "effort")


@dataclass(frozen=True, eq=False)
class Imu:
    """What an inertial measurement unit said, in its own frame.

    Attributes:
        angular_velocity: (samples, 3) [rad/s].
        linear_acceleration: (samples, 3) [m/s²], the specific force: at rest +9.81 upwards.
        orientation: (samples, 4) quaternion xyzw of the IMU frame in the world, None where there is none.
        frame: name of the IMU frame, None where the log does not say.
    """

    angular_velocity: Array
    linear_acceleration: Array
    orientation: Array | None = None
    frame: str | None = None


@dataclass(frozen=True, eq=False)
class Recording:
    """Samples of joints, IMU and feet on one strictly increasing clock.

    Attributes:
        time: (samples,) [s].
        joints: names, n of them.
        position: (samples, n) [rad].
        velocity: (samples, n) [rad/s], None where not recorded.
        acceleration: (samples, n) [rad/s²], None where not recorded.
        effort: (samples, n) [N·m], what the actuator does to the joint, None where not recorded.
        imu: None where there is none.
        foot_force: by foot, (samples, 3) [N], what the ground does to the foot, world axes.
        foot_contact: by foot, (samples,) bool.
        source: where it came from, for messages.
        notes: what the reader and every later step did to it, one sentence each, in order.

    Raises:
        RecordingError: shapes that do not fit together, a value that is not finite, time that does not increase; the
            message names the source, the column and the sample.
    """

    time: Array
    joints: tuple[str, ...]
    position: Array
    velocity: Array | None = None
    acceleration: Array | None = None
    effort: Array | None = None
    imu: Imu | None = None
    foot_force: Mapping[str, Array] = field(default_factory=dict)
    foot_contact: Mapping[str, NDArray[np.bool_]] = field(default_factory=dict)
    source: str = "recording"
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Validated where made: see the class's Raises."""
        if self.time.ndim != 1:
            raise RecordingError(f"{self.source}: time needs shape (samples,), got {self.time.shape}")
        shape = (len(self.time), len(self.joints))
        for name in _CHANNELS:
            values = getattr(self, name)
            if values is not None and values.shape != shape:
                raise RecordingError(f"{self.source}: {name} needs shape {shape}, got {values.shape}")
        if self.imu is not None:
            _check_imu(self.imu, len(self.time), self.source)
        for foot, force in self.foot_force.items():
            _check_shape(force, (len(self.time), 3), f"{foot}.force", self.source)
        for foot, contact in self.foot_contact.items():
            _check_shape(contact, (len(self.time),), f"{foot}.contact", self.source)
        _check_time(self.time, self.source)
        _check_finite(self)

    def __len__(self) -> int:
        return len(self.time)

    def channel(self, name: str, joints: tuple[str, ...]) -> Array:
        """One of position, velocity, acceleration, effort for the named joints, (samples, len(joints)).

        Raises:
            UnknownNameError: a joint that is not recorded.
            RecordingError: the channel is not recorded.
        """
        values: Array | None = getattr(self, name)
        if values is None:
            raise RecordingError(f"{self.source}: no column '{joints[0]}.{name}'; the log has no joint {name}")
        return values[:, [self.index(joint) for joint in joints]]

    def index(self, joint: str) -> int:
        """The column of a joint.

        Raises:
            UnknownNameError: not recorded.
        """
        if joint not in self.joints:
            raise UnknownNameError("joint", joint, self.joints, self.source)
        return self.joints.index(joint)


def _check_imu(imu: Imu, samples: int, source: str) -> None:
    for name, width in (("angular_velocity", 3), ("linear_acceleration", 3), ("orientation", 4)):
        values = getattr(imu, name)
        if values is not None:
            _check_shape(values, (samples, width), f"imu.{name}", source)


def _check_shape(values: NDArray[np.generic], shape: tuple[int, ...], name: str, source: str) -> None:
    if values.shape != shape:
        raise RecordingError(f"{source}: {name} needs shape {shape}, got {values.shape}")


def _check_time(time: Array, source: str) -> None:
    if not np.isfinite(time).all():
        raise RecordingError(f"{source}: column 'time' is not finite at sample {int(np.argmin(np.isfinite(time)))}")
    steps = np.diff(time)
    if len(steps) and steps.min() <= 0:
        at = int(np.argmax(steps <= 0)) + 1
        what = "stands still" if steps[at - 1] == 0 else "runs back"
        raise RecordingError(f"{source}: column 'time' {what} at sample {at} ({time[at - 1]:.6f} to {time[at]:.6f} s)")


def _check_finite(recording: Recording) -> None:
    labelled = [(getattr(recording, name), name, recording.joints) for name in _CHANNELS]
    if recording.imu is not None:
        for name in ("angular_velocity", "linear_acceleration", "orientation"):
            labelled.append((getattr(recording.imu, name), name, ("imu",) * 4))
    labelled += [(force, "force", (foot,) * 3) for foot, force in recording.foot_force.items()]
    for values, name, owners in labelled:
        if values is not None and not np.isfinite(values).all():
            sample, column = np.argwhere(~np.isfinite(values))[0]
            raise RecordingError(
                f"{recording.source}: column '{owners[column]}.{name}' is not finite at sample {sample}"
            )
