"""Topics as Zenoh knows them: the key expressions and liveliness tokens of rmw_zenoh and of zenoh-bridge-ros2dds.

rmw_zenoh (https://github.com/ros2/rmw_zenoh, docs/design.md) puts domain, type and type hash (REP 2016) into the key::

    0/joint_states/sensor_msgs::msg::dds_::JointState_/RIHS01_a13e...
    @ros2_lv/0/<session>/<node>/<entity>/MP/%/%/<node name>/%joint_states/<type>/<hash>/<qos>          publisher's token

and requires an attachment: sequence number and time of sending [ns] as little-endian int64, and 16 bytes that
identify the publisher, after their number. Its releases before June 2025 wrote the names of the three before them.

zenoh-bridge-ros2dds (https://github.com/eclipse-zenoh/zenoh-plugin-ros2dds) uses the topic's name alone as the key;
the type is in the token, slashes written as §::

    lowstate
    @/<session>/@ros2_lv/MP/lowstate/unitree_go§msg§LowState/<qos>

Both carry the message as CDR with its header of four bytes.
"""

from __future__ import annotations

import struct
from typing import NamedTuple

TOKENS = ("@ros2_lv/**", "@/*/@ros2_lv/**")
"""Where both announce topics."""

NO_HASH = "TypeHashNotSupported"
"""What ROS 2 Humble has in the place of a type hash."""

_LABELS = (b"\x0fsequence_number", b"\x10source_timestamp", b"\x0asource_gid")
_GID = 16  # bytes
_QOS = "::,10:,:,:,,"  # reliable, volatile, the last ten: rmw_zenoh's way to write its defaults


class Key(NamedTuple):
    """What a key or a token says of a topic.

    Attributes:
        topic: ROS name, with a leading slash.
        kind: ROS type, such as "sensor_msgs/msg/Imu"; empty where the key does not say.
        domain: ROS domain; None of the bridge.
        type_hash: as in the key; empty of the bridge.
    """

    topic: str
    kind: str = ""
    domain: int | None = None
    type_hash: str = ""


class Sent(NamedTuple):
    """An attachment of rmw_zenoh: number and time of sending [ns] of a message, and its publisher."""

    sequence: int
    stamp: int
    publisher: bytes


def read_key(key: str) -> Key:
    """The topic of a key, of whichever of the two."""
    parts = key.split("/")
    if len(parts) >= 4 and parts[0].isdigit() and "::dds_::" in parts[-2]:
        return Key("/" + "/".join(parts[1:-2]), ros_type(parts[-2]), int(parts[0]), parts[-1])
    return Key(f"/{key}")


def read_token(token: str) -> tuple[str, Key] | None:
    """Key and topic of a publisher's token; None of other tokens."""
    parts = token.split("/")
    if parts[0] == "@ros2_lv" and len(parts) >= 12 and parts[5] == "MP" and parts[1].isdigit():
        name, kind, type_hash = parts[9].replace("%", "/"), parts[10], parts[11]
        return f"{parts[1]}{name}/{kind}/{type_hash}", Key(name, ros_type(kind), int(parts[1]), type_hash)
    if parts[0] == "@" and len(parts) >= 6 and parts[2:4] == ["@ros2_lv", "MP"]:
        key = parts[4].replace("§", "/")
        return key, Key(f"/{key}", parts[5].replace("§", "/"))
    return None


def topic_key(domain: int, topic: str, kind: str, type_hash: str) -> str:
    """The key by which rmw_zenoh publishes a topic, or serves a service."""
    return f"{domain}/{topic.strip('/')}/{dds_type(kind)}/{type_hash}"


def token(domain: int, session: str, entity: int, what: str, key: str = "") -> str:
    """The token that announces our node ("NN"), a publisher ("MP") or a service ("SS") of a key to rmw_zenoh."""
    whose = f"@ros2_lv/{domain}/{session}/0/{entity}/{what}/%/%/stadera"
    if not key:
        return whose
    _, *topic, kind, type_hash = key.split("/")
    return f"{whose}/%{'%'.join(topic)}/{kind}/{type_hash}/{_QOS}"


def read_attachment(data: bytes) -> Sent | None:
    """What rmw_zenoh attached to a message; None where it is something else."""
    for label in _LABELS:
        data = data.replace(label, b"", 1)
    if len(data) != 17 + _GID or data[16] != _GID:
        return None
    sequence, stamp = struct.unpack_from("<qq", data)
    return Sent(sequence, stamp, data[17:])


def attachment(sent: Sent) -> bytes:
    """What rmw_zenoh expects to be attached to a message."""
    return struct.pack("<qqB", sent.sequence, sent.stamp, _GID) + sent.publisher


def dds_type(kind: str) -> str:
    """A ROS type as DDS names it: sensor_msgs::msg::dds_::Imu_ of sensor_msgs/msg/Imu."""
    package, part, name = kind.split("/")
    return f"{package}::{part}::dds_::{name}_"


def ros_type(kind: str) -> str:
    """A DDS type as ROS names it; as it is where it is none of ROS's."""
    return kind.removesuffix("_").replace("::dds_::", "::").replace("::", "/")
