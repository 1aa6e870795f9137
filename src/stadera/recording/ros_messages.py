"""What is in a JointState and in an Imu, out of their bytes."""

from __future__ import annotations

from functools import cache
from typing import Any, NamedTuple

import numpy as np
import zstandard
from numpy.typing import NDArray
from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.store import Typestore

from stadera.errors import RecordingError

Array = NDArray[np.float64]

JOINT_STATE = "sensor_msgs/msg/JointState"
IMU = "sensor_msgs/msg/Imu"

_ZSTD = b"\x28\xb5\x2f\xfd"
"""How a message begins that was compressed on its own."""


class JointState(NamedTuple):
    """A JointState.

    Attributes:
        stamp: of its header [ns].
        names: of the joints.
        channels: position, velocity, effort; each with a value for every name, or empty.
    """

    stamp: int
    names: tuple[str, ...]
    channels: tuple[Array, Array, Array]


class ImuState(NamedTuple):
    """An Imu.

    Attributes:
        stamp: of its header [ns].
        frame: frame_id, without a leading slash; may be empty.
        values: (10,), angular velocity, specific force, orientation xyzw; NaN where the message says that it has none.
    """

    stamp: int
    frame: str
    values: Array


def joint_state(data: bytes, source: str) -> JointState:
    """The JointState in these bytes.

    Raises:
        RecordingError: bytes that are none, a channel with another number of values than there are names.
    """
    message = _decoded(data, JOINT_STATE, source)
    names = tuple(message.name)
    channels = (message.position, message.velocity, message.effort)
    for channel, values in zip(("position", "velocity", "effort"), channels, strict=True):
        if len(values) not in (0, len(names)):
            raise RecordingError(f"{source}: a JointState has {len(names)} names and {len(values)} of {channel}")
    return JointState(_stamp(message), names, channels)


def imu_state(data: bytes, source: str) -> ImuState:
    """The Imu in these bytes. A covariance that begins with -1, or a quaternion of zeros, says that there is none.

    Raises:
        RecordingError: bytes that are none.
    """
    message = _decoded(data, IMU, source)
    gyro, force, turn = message.angular_velocity, message.linear_acceleration, message.orientation
    values = np.array([gyro.x, gyro.y, gyro.z, force.x, force.y, force.z, turn.x, turn.y, turn.z, turn.w])
    if message.angular_velocity_covariance[0] == -1:
        values[:3] = np.nan
    if message.linear_acceleration_covariance[0] == -1:
        values[3:6] = np.nan
    if message.orientation_covariance[0] == -1 or not values[6:].any():
        values[6:] = np.nan
    return ImuState(_stamp(message), str(message.header.frame_id).lstrip("/"), values)


def _decoded(data: bytes, kind: str, source: str) -> Any:
    try:
        return _types().deserialize_cdr(zstandard.decompress(data) if data[:4] == _ZSTD else data, kind)
    except Exception as error:  # the library meets damaged bytes with errors of many kinds
        raise RecordingError(f"{source}: damaged message, no {kind}: {' '.join(str(error).split())[:100]}") from None


@cache
def _types() -> Typestore:
    """Definitions of a release; both types are alike in all of ROS 2."""
    return get_typestore(Stores.ROS2_HUMBLE)


def _stamp(message: Any) -> int:
    return int(message.header.stamp.sec) * 1_000_000_000 + int(message.header.stamp.nanosec)
