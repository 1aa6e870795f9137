"""Decodes messages: joints' states and Imu of ROS 1 and 2, and Unitree's LowState."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from stadera.errors import RecordingError
from stadera.limits import DEFAULTS
from stadera.logs.bags.container import Message, Messages, Sample, SampleBatch, Topic
from stadera.logs.bags.repeated import Repeated
from stadera.logs.bags.settings import BagSettings
from stadera.logs.bags.states import CHANNELS, PUBLISHED, Find, finder
from stadera.logs.columns import IMU_COLUMNS

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

JOINT_STATE = "sensor_msgs/msg/JointState"
IMU = "sensor_msgs/msg/Imu"
IMU_NAMES = tuple(name for names in IMU_COLUMNS.values() for name in names)

_LARGEST_MESSAGE = 1 << 24
"""Largest size of a message that does not state its size [bytes]."""
ZSTD = b"\x28\xb5\x2f\xfd"
"""First bytes of a message that was compressed individually."""


class Decoder(Protocol):
    """Decodes one topic's messages in order; on damaged ones it raises errors of many kinds."""

    def __call__(self, message: Message) -> Sample:
        """The values of one message."""
        ...

    def many(self, messages: Messages) -> SampleBatch | None:
        """The same values from several messages at once; None, without having read any, if they are not laid out
        alike.
        """
        ...


def decoder(topic: Topic, encoding: str, joints: Sequence[str] | None, settings: BagSettings) -> Decoder:
    """Returns the decoder of a topic's messages in "cdr" or "ros1"; motors without names are mapped to the requested
    joints.
    """
    if is_low_state(topic):
        from stadera.logs.bags.unitree import LowStates

        return LowStates(topic, encoding, joints, settings)
    types = _types(topic, encoding)
    deserialize = types.deserialize_ros1 if encoding == "ros1" else types.deserialize_cdr
    read = _imu if topic.kind == IMU else _states(finder(types.fielddefs, topic.kind), topic.kind)

    def decode(message: Message) -> Sample:
        return read(message, deserialize(uncompressed(message.data), topic.kind))

    usual = encoding == "cdr" and topic.kind in (JOINT_STATE, IMU)
    return Repeated(decode, is_imu=topic.kind == IMU if usual else None)


def is_low_state(topic: Topic) -> bool:
    """Whether messages are Unitree's LowState, of ROS 2 or of a ROS 1 package of its older robots."""
    from stadera.logs.bags.unitree import LOW_STATES

    return topic.kind in LOW_STATES or (topic.kind.endswith("/LowState") and "otor" in topic.definition)


def has_states(topic: Topic, encoding: str) -> bool:
    """True if messages other than JointState or LowState contain joints' states in a known layout."""
    if "position" not in topic.definition and topic.kind not in PUBLISHED and "Statistic" not in topic.definition:
        return False
    try:
        return finder(_types(topic, encoding).fielddefs, topic.kind) is not None
    except Exception:  # of many kinds, if the definition is damaged or in another language
        return False


def uncompressed(data: bytes) -> bytes:
    """A message's bytes, unpacked if it was compressed individually. Raises LimitError: it unpacks to more than any
    message contains.
    """
    if data[:4] != ZSTD:
        return data
    import zstandard

    size = zstandard.frame_content_size(data)
    DEFAULTS.require("unpacked", size, "a message", "bytes that it unpacks to")
    if size < 0:  # not stated
        return zstandard.ZstdDecompressor().stream_reader(data).read(_LARGEST_MESSAGE)
    return zstandard.ZstdDecompressor().decompress(data)


@cache
def joint_columns(names: tuple[str, ...]) -> tuple[str, ...]:
    """Columns of the joints' positions, velocities and efforts."""
    return tuple(f"{name}.{channel}" for channel in CHANNELS for name in names)


def _states(find: Find | None, kind: str) -> Callable[[Message, Any], Sample]:
    """Returns a decoder of messages that contain joints' states."""
    if find is None:
        raise RecordingError(f"a {kind} in this log has no joints' states: its definition is another one")

    def read(message: Message, content: Any) -> Sample:
        names, channels = find(content)
        blank = np.full(len(names), np.nan)
        rows = [channels.get(channel, blank) for channel in CHANNELS]
        if wrong := next((c for c, row in zip(CHANNELS, rows, strict=True) if len(row) not in (0, len(names))), None):
            count = len(channels[wrong])
            raise RecordingError(f"{message.topic}: a message has {len(names)} names and {count} of {wrong}")
        values = np.concatenate([row if len(row) else blank for row in rows])
        stamp = _stamp(content) if hasattr(content, "header") else message.received
        return Sample(message.topic, message.received, stamp, "", joint_columns(names), values)

    return read


def _imu(message: Message, content: Any) -> Sample:
    """Decodes an Imu, in which a covariance that begins with -1, or a quaternion of zeros, marks unknown values."""
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
def _types(topic: Topic, encoding: str) -> Typestore:
    """Type definitions of a release, with JointState and Imu as in all of ROS 2 or all of ROS 1, and the topic's
    own.
    """
    from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC if encoding == "ros1" else Stores.ROS2_HUMBLE)
    if topic.kind not in store.types:
        definition = topic.definition or PUBLISHED.get(topic.kind, "")
        is_idl = "module " in definition and "struct " in definition
        found = get_types_from_idl(definition) if is_idl else get_types_from_msg(definition, topic.kind)
        store.register({kind: fields for kind, fields in found.items() if kind not in store.types})
    return store
