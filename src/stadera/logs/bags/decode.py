"""Values of messages from their bytes: JointState and Imu of ROS 1 and 2, and Unitree's LowState."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from stadera.errors import RecordingError
from stadera.logs.bags.container import Message, Topic
from stadera.logs.bags.settings import BagSettings
from stadera.logs.columns import IMU_COLUMNS
from stadera.types import Array

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

JOINT_STATE = "sensor_msgs/msg/JointState"
IMU = "sensor_msgs/msg/Imu"
CHANNELS = ("position", "velocity", "effort")
IMU_NAMES = tuple(name for names in IMU_COLUMNS.values() for name in names)

_ZSTD = b"\x28\xb5\x2f\xfd"
"""How a message begins that was compressed on its own."""


class Sample(NamedTuple):
    """The values of one message.

    Attributes:
        topic: of the message.
        received: when it was recorded [ns].
        stamp: when it was measured [ns].
        frame: of the IMU, without a leading slash; may be empty.
        columns: names of the flat table.
        values: (columns,); NaN where the message marks them as unknown.
    """

    topic: str
    received: int
    stamp: int
    frame: str
    columns: tuple[str, ...]
    values: Array


Decoder = Callable[[Message], Sample]


def decoder(topic: Topic, encoding: str, joints: Sequence[str] | None, settings: BagSettings) -> Decoder:
    """The decoder of a topic's messages. It raises errors of many kinds on damaged ones.

    Args:
        topic: its type and definition.
        encoding: "cdr" or "ros1".
        joints: that are asked for; motors without names are mapped to these.
        settings: how stamps are corrected.
    """
    if topic.kind in (JOINT_STATE, IMU):
        store, read = _types(encoding), _joint_state if topic.kind == JOINT_STATE else _imu
        deserialize = store.deserialize_ros1 if encoding == "ros1" else store.deserialize_cdr
        return lambda message: read(message, deserialize(uncompressed(message.data), topic.kind))
    from stadera.logs.bags.unitree import LowStates

    return LowStates(topic, joints, settings)


def uncompressed(data: bytes) -> bytes:
    """A message's bytes, unpacked if it was compressed on its own."""
    if data[:4] != _ZSTD:
        return data
    import zstandard

    return zstandard.decompress(data)


@cache
def joint_columns(names: tuple[str, ...]) -> tuple[str, ...]:
    """The columns of joints' positions, velocities and efforts."""
    return tuple(f"{name}.{channel}" for channel in CHANNELS for name in names)


def _joint_state(message: Message, content: Any) -> Sample:
    names, blank = tuple(content.name), np.full(len(content.name), np.nan)
    channels = [getattr(content, channel) for channel in CHANNELS]
    for channel, values in zip(CHANNELS, channels, strict=True):
        if len(values) not in (0, len(names)):
            raise RecordingError(f"{message.topic}: a JointState has {len(names)} names and {len(values)} of {channel}")
    values = np.concatenate([values if len(values) else blank for values in channels])
    return Sample(message.topic, message.received, _stamp(content), "", joint_columns(names), values)


def _imu(message: Message, content: Any) -> Sample:
    """A covariance that begins with -1, or a quaternion of zeros, marks unknown values (sensor_msgs/Imu)."""
    gyro, force, turn = content.angular_velocity, content.linear_acceleration, content.orientation
    values = np.array([gyro.x, gyro.y, gyro.z, force.x, force.y, force.z, turn.x, turn.y, turn.z, turn.w])
    if content.angular_velocity_covariance[0] == -1:
        values[:3] = np.nan
    if content.linear_acceleration_covariance[0] == -1:
        values[3:6] = np.nan
    if content.orientation_covariance[0] == -1 or not values[6:].any():
        values[6:] = np.nan
    frame = str(content.header.frame_id).lstrip("/")
    return Sample(message.topic, message.received, _stamp(content), frame, IMU_NAMES, values)


def _stamp(content: Any) -> int:
    return int(content.header.stamp.sec) * 1_000_000_000 + int(content.header.stamp.nanosec)


@cache
def _types(encoding: str) -> Typestore:
    """Definitions of a release: both types are alike in all of ROS 2, and in all of ROS 1."""
    from rosbags.typesys import Stores, get_typestore

    return get_typestore(Stores.ROS1_NOETIC if encoding == "ros1" else Stores.ROS2_HUMBLE)
