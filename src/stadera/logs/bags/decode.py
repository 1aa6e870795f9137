"""Decodes messages: joints' states and Imu of ROS 1 and 2 by rosbags, field by field, and Unitree's LowState.

Joints' states are found in messages of any type by the names of their fields. Known layouts, at the top of a message or
in one of its parts:

- arrays of names and of values: sensor_msgs/JointState, any_msgs/ExtendedJointState of ANYmal,
  control_msgs/JointTrajectoryControllerState (names at the top, values in `feedback` or `actual`);
- an array of parts with a name and values each: whole_body_state_msgs/WholeBodyState;
- names, and for each its interfaces with their values: control_msgs/DynamicJointState of ros2_control;
- named numbers: pal_statistics_msgs/Statistics, "state_interface.<joint>/<interface>" of ros2_control.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import cache
from importlib import resources
from itertools import groupby
from typing import TYPE_CHECKING, Any

import numpy as np

from stadera.errors import RecordingError
from stadera.limits import DEFAULTS
from stadera.logs.bags.container import BagSettings, Decoded, Message, Topic, unpacked
from stadera.logs.columns import IMU_COLUMNS
from stadera.logs.columns import OTHER_CHANNELS as CHANNELS
from stadera.types import Array

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

JOINT_STATE = "sensor_msgs/msg/JointState"
IMU = "sensor_msgs/msg/Imu"
IMU_NAMES = tuple(name for names in IMU_COLUMNS.values() for name in names)

ZSTD = b"\x28\xb5\x2f\xfd"
"""First bytes of a message that was compressed individually."""

Columns = tuple[str, ...]

Decoder = Callable[[Sequence[Message]], list[Decoded]]
"""Decodes successive messages of one topic. On damaged ones it raises errors of many kinds, and may be asked again for
fewer of them.
"""

States = tuple[tuple[str, ...], Mapping[str, Array]]
"""Names of joints, and by channel their values (joints,), NaN for missing ones; channels may be absent."""

Find = Callable[[Any], States]
"""Extracts the joints' states from a decoded message."""

_NAMES = ("name", "names", "joint_names", "joint_name")
_WORDS = {
    "position": ("position", "positions"),
    "velocity": ("velocity", "velocities"),
    "effort": ("effort", "efforts", "torque", "torques"),
}
_MEASURED = ("feedback", "actual")
_STATISTIC = re.compile(r"^(?:state_interface[./])?(?P<joint>[^/]+?)[./](?P<word>\w+)$")
_COMMAND = re.compile(r"command|desired|reference")


@cache
def published(kind: str) -> str:
    """The definition of a type that bags without definitions may have, of Unitree's restricted to the fields read here;
    empty for others. Sources: https://github.com/ros-controls/control_msgs, https://github.com/pal-robotics/pal_statistics,
    https://github.com/unitreerobotics/unitree_ros2.
    """
    file = resources.files(__package__) / "definitions" / f"{kind.replace('/', '-')}.msg"
    return file.read_text(encoding="utf-8") if file.is_file() else ""


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

    def decode(messages: Sequence[Message]) -> list[Decoded]:
        found = [(m, *read(m, deserialize(uncompressed(m.data), topic.kind))) for m in messages]
        return [_together(layout, list(alike)) for layout, alike in groupby(found, key=lambda one: one[1:3])]

    return decode


def is_low_state(topic: Topic) -> bool:
    """Whether messages are Unitree's LowState, of ROS 2 or of a ROS 1 package of its older robots."""
    from stadera.logs.bags.unitree import LOW_STATES

    return topic.kind in LOW_STATES or (topic.kind.endswith("/LowState") and "otor" in topic.definition)


def has_states(topic: Topic, encoding: str) -> bool:
    """True if messages other than JointState or LowState contain joints' states in a known layout."""
    if "position" not in topic.definition and not published(topic.kind) and "Statistic" not in topic.definition:
        return False
    try:
        return finder(_types(topic, encoding).fielddefs, topic.kind) is not None
    except Exception:  # of many kinds, if the definition is damaged or in another language
        return False


def uncompressed(data: bytes) -> bytes:
    """A message's bytes, unpacked if it was compressed individually. Raises LimitError: it unpacks to more than any
    message contains.
    """
    return unpacked(data, "zstd", DEFAULTS, "a message") if data[:4] == ZSTD else data


@cache
def joint_columns(names: tuple[str, ...]) -> tuple[str, ...]:
    """Columns of the joints' positions, velocities and efforts."""
    return tuple(f"{name}.{channel}" for channel in CHANNELS for name in names)


def joints_in(columns: Iterable[str]) -> Columns:
    """Joints with a position among these columns."""
    return tuple(name.removesuffix(".position") for name in columns if name.endswith(".position"))


_Read = Callable[[Message, Any], tuple[str, tuple[str, ...], int, Array]]
"""Of a message and its content: the frame, the columns' names, the stamp [ns], and the values (columns,)."""


def _states(find: Find | None, kind: str) -> _Read:
    """Returns the function that reads messages with joints' states."""
    if find is None:
        raise RecordingError(f"a {kind} in this log has no joints' states: its definition is another one")

    def read(message: Message, content: Any) -> tuple[str, tuple[str, ...], int, Array]:
        names, channels = find(content)
        blank = np.full(len(names), np.nan)
        rows = [channels.get(channel, blank) for channel in CHANNELS]
        if wrong := next((c for c, row in zip(CHANNELS, rows, strict=True) if len(row) not in (0, len(names))), None):
            count = len(channels[wrong])
            raise RecordingError(f"{message.topic}: a message has {len(names)} names and {count} of {wrong}")
        values = np.concatenate([row if len(row) else blank for row in rows])
        return "", joint_columns(names), _stamp(content) if hasattr(content, "header") else message.received, values

    return read


def _imu(_: Message, content: Any) -> tuple[str, tuple[str, ...], int, Array]:
    """Reads an Imu, in which a covariance that begins with -1, or a quaternion of zeros, marks unknown values."""
    gyro, force, turn = content.angular_velocity, content.linear_acceleration, content.orientation
    values = np.array([gyro.x, gyro.y, gyro.z, force.x, force.y, force.z, turn.x, turn.y, turn.z, turn.w])
    if content.angular_velocity_covariance[0] == -1:
        values[:3] = np.nan
    if content.linear_acceleration_covariance[0] == -1:
        values[3:6] = np.nan
    if content.orientation_covariance[0] == -1 or not values[6:].any():
        values[6:] = np.nan
    return str(content.header.frame_id).lstrip("/"), IMU_NAMES, _stamp(content), values


def _together(layout: tuple[str, tuple[str, ...]], alike: Sequence[tuple[Any, ...]]) -> Decoded:
    """Successive messages with the same frame and columns."""
    messages, _, _, stamps, values = zip(*alike, strict=True)
    received = np.array([message.received for message in messages])
    return Decoded(messages[0].topic, received, np.array(stamps), *layout, np.array(values))


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
        definition = topic.definition or published(topic.kind)
        is_idl = "module " in definition and "struct " in definition
        found = get_types_from_idl(definition) if is_idl else get_types_from_msg(definition, topic.kind)
        store.register({kind: fields for kind, fields in found.items() if kind not in store.types})
    return store


def finder(types: Mapping[str, Any], kind: str, depth: int = 2) -> Find | None:
    """Returns the function that finds the joints' states in messages of a type, `depth` nested parts deep, by
    definitions in rosbags' format; None if the layout is not known.
    """
    fields = _fields(types, kind)
    found = _arrays(types, fields) or _interfaces(types, fields) or _structs(types, fields)
    for name, (part, several) in fields.items() if found is None and depth else ():
        if not several and (inner := finder(types, part, depth - 1)):
            return lambda content, name=name, inner=inner: inner(getattr(content, name))  # type: ignore[misc]
    return found


_Fields = dict[str, tuple[str, bool]]


def _fields(types: Mapping[str, Any], kind: str) -> _Fields:
    """Fields of a message type: the type of each, or of its elements, and whether it is an array; none of a number."""
    from rosbags.interfaces import Nodetype

    found: _Fields = {}
    for name, (node, detail) in types[kind][1] if kind in types else ():
        several = node in (Nodetype.ARRAY, Nodetype.SEQUENCE)
        node, detail = detail[0] if several else (node, detail)
        found[name] = str(detail if node == Nodetype.NAME else detail[0]), several
    return found


def _arrays(types: Mapping[str, Any], fields: _Fields) -> Find | None:
    """Arrays of names and values, the values here or in a part with the measured ones."""
    names = _first(_NAMES, [name for name, kind in fields.items() if kind == ("string", True)])
    if names is None:
        return None
    for part in ("", *_MEASURED):
        inside = fields if not part else _fields(types, fields[part][0]) if part in fields else {}
        given = _channels_of(inside)
        if "position" not in given or not inside[given["position"]][1]:
            continue

        def find(content: Any, part: str = part, given: Mapping[str, str] = given) -> States:
            values = getattr(content, part) if part else content
            return tuple(getattr(content, names)), {c: np.asarray(getattr(values, w)) for c, w in given.items()}

        return find
    return None


def _interfaces(types: Mapping[str, Any], fields: _Fields) -> Find | None:
    """Names, and for each the names of its interfaces and their values."""
    part, _ = fields.get("interface_values", ("", False))
    if "joint_names" not in fields or not {"interface_names", "values"} <= _fields(types, part).keys():
        return None

    def find(content: Any) -> States:
        rows = [dict(zip(v.interface_names, v.values, strict=True)) for v in content.interface_values]
        return _of_rows(dict(zip(content.joint_names, rows, strict=True)))

    return find


def _structs(types: Mapping[str, Any], fields: _Fields) -> Find | None:
    """An array of parts, each with a name and values, or with a name that states what its one value is."""
    for field, (part, several) in fields.items():
        inside = _fields(types, part) if several else {}
        names, given = _first(_NAMES, inside), _channels_of(inside)
        if names and "position" in given:

            def find(content: Any, field: str = field, names: str = names, given: Mapping[str, str] = given) -> States:
                parts = getattr(content, field)
                joints = tuple(getattr(part, names) for part in parts)
                return joints, {c: np.array([getattr(part, w) for part in parts]) for c, w in given.items()}

            return find
        if inside.keys() == {"name", "value"}:
            return lambda content, field=field: _named(getattr(content, field))  # type: ignore[misc]
    return None


def _named(numbers: Any) -> States:
    """Joints' states from numbers whose names end in a joint and a channel; commands are skipped."""
    found: dict[str, dict[str, float]] = {}
    for number in numbers:
        if (match := _STATISTIC.match(number.name)) and not _COMMAND.search(number.name):
            channel = next((c for c in CHANNELS if match["word"] in _WORDS[c]), None)
            if channel:
                found.setdefault(match["joint"], {})[channel] = float(number.value)
    return _of_rows(found)


def _of_rows(found: Mapping[str, Mapping[str, float]]) -> States:
    """States of the joints that have a position, by joint and channel."""
    joints = {joint: row for joint, row in found.items() if "position" in row}
    return tuple(joints), {c: np.array([row.get(c, np.nan) for row in joints.values()]) for c in CHANNELS}


def _first(wanted: tuple[str, ...], names: Any) -> str | None:
    return next((name for name in wanted if name in names), None)


def _channels_of(fields: Any) -> dict[str, str]:
    """By channel, the field with its values, of those that there are."""
    words = {channel: _first(_WORDS[channel], fields) for channel in CHANNELS}
    return {channel: word for channel, word in words.items() if word is not None}
