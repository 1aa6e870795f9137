"""Decodes messages: joints' states and Imu of ROS 1 and 2, and Unitree's LowState.

rosbags reads every field of a message. Of JointState and Imu in CDR, the numbers are then read by their positions while
messages have the same layout: a header is a stamp of 8 bytes and the frame's name; everything up to the first number
(including names of joints) is the same in successive messages of a publisher, so the numbers keep their positions:
doubles, aligned to 8 bytes after the four of the encapsulation.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache
from itertools import takewhile
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from stadera.errors import RecordingError
from stadera.limits import DEFAULTS
from stadera.logs.bags.container import BagSettings, Decoded, Message, Topic
from stadera.logs.bags.states import CHANNELS, PUBLISHED, Find, finder
from stadera.logs.columns import IMU_COLUMNS
from stadera.types import Array

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

JOINT_STATE = "sensor_msgs/msg/JointState"
IMU = "sensor_msgs/msg/Imu"
IMU_NAMES = tuple(name for names in IMU_COLUMNS.values() for name in names)

ZSTD = b"\x28\xb5\x2f\xfd"
"""First bytes of a message that was compressed individually."""


_LITTLE = b"\0\1\0\0"  # encapsulation of CDR in little-endian order
_STAMP = 4 + 8  # start of the frame's name: after encapsulation and stamp
_IMU_ORDER = np.array([13, 14, 15, 25, 26, 27, 0, 1, 2, 3])
_UNKNOWN = ((16, slice(0, 3)), (28, slice(3, 6)), (4, slice(6, 10)))  # covariances that begin with -1, and their values

Decoder = Callable[[Sequence[Message]], list[Decoded]]
"""Decodes successive messages of one topic. On damaged ones it raises errors of many kinds, and may be asked again for
fewer of them.
"""


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

    def decode(message: Message) -> Decoded:
        return read(message, deserialize(uncompressed(message.data), topic.kind))

    if encoding == "cdr" and topic.kind in (JOINT_STATE, IMU):
        return _Repeated(decode, is_imu=topic.kind == IMU)
    return lambda messages: [decode(message) for message in messages]


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
        return zstandard.ZstdDecompressor().stream_reader(data).read(1 << 24)
    return zstandard.ZstdDecompressor().decompress(data)


@cache
def joint_columns(names: tuple[str, ...]) -> tuple[str, ...]:
    """Columns of the joints' positions, velocities and efforts."""
    return tuple(f"{name}.{channel}" for channel in CHANNELS for name in names)


def _states(find: Find | None, kind: str) -> Callable[[Message, Any], Decoded]:
    """Returns a decoder of messages that contain joints' states."""
    if find is None:
        raise RecordingError(f"a {kind} in this log has no joints' states: its definition is another one")

    def read(message: Message, content: Any) -> Decoded:
        names, channels = find(content)
        blank = np.full(len(names), np.nan)
        rows = [channels.get(channel, blank) for channel in CHANNELS]
        if wrong := next((c for c, row in zip(CHANNELS, rows, strict=True) if len(row) not in (0, len(names))), None):
            count = len(channels[wrong])
            raise RecordingError(f"{message.topic}: a message has {len(names)} names and {count} of {wrong}")
        values = np.concatenate([row if len(row) else blank for row in rows])
        stamp = _stamp(content) if hasattr(content, "header") else message.received
        return _of_one(message, stamp, "", joint_columns(names), values)

    return read


def _imu(message: Message, content: Any) -> Decoded:
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
    return _of_one(message, _stamp(content), frame, IMU_NAMES, values)


def _of_one(message: Message, stamp: int, frame: str, columns: tuple[str, ...], values: Array) -> Decoded:
    """The values (columns,) of one message."""
    return Decoded(message.topic, np.array([message.received]), np.array([stamp]), frame, columns, values[None])


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


class _Repeated:
    """Reads messages by the positions of their numbers in the last one that `decode` read, if they have its layout."""

    def __init__(self, decode: Callable[[Message], Decoded], *, is_imu: bool) -> None:
        self._decode, self._is_imu = decode, is_imu
        self._like: Decoded | None = None
        self._data = b""  # of the message that was read
        self._same: tuple[slice, ...] = ()  # its bytes that are the same in every message of this layout
        self._numbers = byte_places([], 8)

    def __call__(self, messages: Sequence[Message]) -> list[Decoded]:
        found: list[Decoded] = []
        while messages:
            alike = list(takewhile(self._is_alike, messages))
            if alike and self._like is not None:
                found.append(self._by_position(alike, self._like))
            else:
                alike = [messages[0]]
                found.append(self._decode(messages[0]))
                self._learn(messages[0].data, found[-1])
            messages = messages[len(alike) :]
        return found

    def _is_alike(self, message: Message) -> bool:
        data, own = message.data, self._data
        return len(data) == len(own) and all(data[part] == own[part] for part in self._same)

    def _by_position(self, messages: Sequence[Message], like: Decoded) -> Decoded:
        rows = byte_rows([message.data for message in messages])
        numbers = numbers_at(rows, self._numbers, "<f8")
        values = numbers[:, _IMU_ORDER] if self._is_imu else numbers
        if self._is_imu:
            for covariance, part in _UNKNOWN:
                values[numbers[:, covariance] == -1.0, part] = np.nan
            values[~values[:, 6:].any(axis=1), 6:] = np.nan
        seconds, rest = (numbers_at(rows, byte_places([at], 4), kind)[:, 0] for at, kind in ((4, "<i4"), (8, "<u4")))
        received = np.array([message.received for message in messages])
        stamps = seconds.astype(np.int64) * 1_000_000_000 + rest
        return Decoded(like.topic, received, stamps, like.frame, like.columns, values)

    def _learn(self, data: bytes, samples: Decoded) -> None:
        """Determines the positions of the numbers in messages like this one."""
        joints = len(samples.columns) // 3
        # an Imu has quaternion, rates and specific force, each followed by its covariance; a JointState three arrays,
        # the second and third preceded by 8 bytes with their length
        count = 4 + 9 + 2 * (3 + 9) if self._is_imu else 3 * joints + 2
        first = len(data) - 8 * count
        lengths = [] if self._is_imu else [first + 8 * joints, first + 16 * joints + 8]
        self._data = b""
        if data[:4] != _LITTLE or (first - 4) % 8 or first <= _STAMP or not joints:
            return  # more data follows, or an array is empty
        if any(data[at : at + 4] != joints.to_bytes(4, "little") for at in lengths):
            return
        self._like, self._data = samples, data
        self._same = (slice(4), slice(_STAMP, first), *(slice(at, at + 4) for at in lengths))
        self._numbers = byte_places([at for at in range(first, len(data), 8) if at not in lengths], 8)


def byte_rows(messages: Sequence[bytes]) -> NDArray[np.uint8]:
    """The bytes of messages of one length, (messages, length)."""
    return np.frombuffer(b"".join(messages), np.uint8).reshape(len(messages), -1)


def byte_places(offsets: Sequence[int], size: int) -> NDArray[np.int64]:
    """Positions of the bytes of some numbers, (numbers, size)."""
    return np.array(offsets, dtype=np.int64)[:, None] + np.arange(size)


def numbers_at(rows: NDArray[np.uint8], places: NDArray[np.int64], kind: str) -> NDArray[Any]:
    """Numbers of a type at these positions of each row of bytes, (rows, numbers)."""
    return rows.take(places.ravel(), axis=1).view(kind)
