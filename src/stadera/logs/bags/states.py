"""Finds joints' states in messages of any type by the names of their fields.

Known layouts, at the top of a message or in one of its parts:

- arrays of names and of values: sensor_msgs/JointState, any_msgs/ExtendedJointState of ANYmal,
  control_msgs/JointTrajectoryControllerState (names at the top, values in `feedback` or `actual`);
- an array of parts with a name and values each: whole_body_state_msgs/WholeBodyState;
- names, and for each its interfaces with their values: control_msgs/DynamicJointState of ros2_control;
- named numbers: pal_statistics_msgs/Statistics, "state_interface.<joint>/<interface>" of ros2_control.
"""

import re
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from stadera.types import Array

CHANNELS = ("position", "velocity", "effort")
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

PUBLISHED = {
    "control_msgs/msg/DynamicJointState": "std_msgs/Header header\nstring[] joint_names\n"
    f"InterfaceValue[] interface_values\n{'=' * 80}\nMSG: control_msgs/InterfaceValue\n"
    "string[] interface_names\nfloat64[] values\n",
    "pal_statistics_msgs/msg/Statistics": "std_msgs/Header header\nStatistic[] statistics\n"
    f"{'=' * 80}\nMSG: pal_statistics_msgs/Statistic\nstring name\nfloat64 value\n",
}
"""Definitions of types that bags without definitions may have (https://github.com/ros-controls/control_msgs,
https://github.com/pal-robotics/pal_statistics)."""


def finder(types: Mapping[str, Any], kind: str, depth: int = 2) -> Find | None:
    """Returns the function that finds the joints' states in messages of a type, `depth` nested parts deep, by
    definitions in rosbags' format; None if the layout is not known.
    """
    fields = dict(types[kind][1]) if kind in types else {}
    found = _arrays(types, fields) or _interfaces(types, fields) or _structs(types, fields)
    if found or not depth:
        return found
    for name, description in fields.items():
        if (part := _part(description)) and (inner := finder(types, part, depth - 1)):
            return lambda content, name=name, inner=inner: inner(getattr(content, name))  # type: ignore[misc]
    return None


def _arrays(types: Mapping[str, Any], fields: Mapping[str, Any]) -> Find | None:
    """Arrays of names and values, the values here or in a part with the measured ones."""
    names = _first(_NAMES, [name for name in fields if _element(fields[name]) == "string"])
    if names is None:
        return None
    for part in ("", *_MEASURED):
        inside = fields if not part else dict(types[_part(fields[part])][1]) if part in fields else {}
        given = _channels_of(inside)
        if "position" not in given or not _element(inside[given["position"]]):
            continue

        def find(content: Any, part: str = part, given: Mapping[str, str] = given) -> States:
            values = getattr(content, part) if part else content
            return tuple(getattr(content, names)), {c: np.asarray(getattr(values, w)) for c, w in given.items()}

        return find
    return None


def _interfaces(types: Mapping[str, Any], fields: Mapping[str, Any]) -> Find | None:
    """Names, and for each the names of its interfaces and their values."""
    part = _element(fields.get("interface_values"))
    if "joint_names" not in fields or part not in types:
        return None
    if {name for name, _ in types[part][1]} < {"interface_names", "values"}:
        return None

    def find(content: Any) -> States:
        rows = [dict(zip(v.interface_names, v.values, strict=True)) for v in content.interface_values]
        joints = [(n, row) for n, row in zip(content.joint_names, rows, strict=True) if "position" in row]
        return tuple(n for n, _ in joints), {c: np.array([r.get(c, np.nan) for _, r in joints]) for c in CHANNELS}

    return find


def _structs(types: Mapping[str, Any], fields: Mapping[str, Any]) -> Find | None:
    """An array of parts, each with a name and values, or with a name that states what its one value is."""
    for field, description in fields.items():
        part = _element(description)
        inside = [name for name, _ in types[part][1]] if part in types else []
        names, given = _first(_NAMES, inside), _channels_of(inside)
        if names and "position" in given:

            def find(content: Any, field: str = field, names: str = names, given: Mapping[str, str] = given) -> States:
                parts = getattr(content, field)
                joints = tuple(getattr(part, names) for part in parts)
                return joints, {c: np.array([getattr(part, w) for part in parts]) for c, w in given.items()}

            return find
        if set(inside) == {"name", "value"}:
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
    joints = {joint: row for joint, row in found.items() if "position" in row}
    return tuple(joints), {c: np.array([row.get(c, np.nan) for row in joints.values()]) for c in CHANNELS}


def _first(wanted: tuple[str, ...], names: Any) -> str | None:
    return next((name for name in wanted if name in names), None)


def _channels_of(fields: Any) -> dict[str, str]:
    """By channel, the field with its values, of those that there are."""
    words = {channel: _first(_WORDS[channel], fields) for channel in CHANNELS}
    return {channel: word for channel, word in words.items() if word is not None}


def _part(description: Any) -> str:
    """The type of a field that is one message; empty for others."""
    from rosbags.interfaces import Nodetype

    node, detail = description
    return str(detail) if node == Nodetype.NAME else ""


def _element(description: Any) -> str:
    """The type of an array's elements; empty for fields that are no arrays."""
    from rosbags.interfaces import Nodetype

    if description is None or description[0] not in (Nodetype.ARRAY, Nodetype.SEQUENCE):
        return ""
    node, detail = description[1][0]
    return str(detail if node == Nodetype.NAME else detail[0])
