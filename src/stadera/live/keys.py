"""Key expressions and liveliness tokens of topics in Zenoh, as used by rmw_zenoh and zenoh-bridge-ros2dds.

rmw_zenoh (https://github.com/ros2/rmw_zenoh, docs/design.md) puts domain, type and type hash (REP 2016) into the key::

    0/joint_states/sensor_msgs::msg::dds_::JointState_/RIHS01_a13e...
    @ros2_lv/0/<session>/<node>/<entity>/MP/%/%/<node name>/%joint_states/<type>/<hash>/<qos>          publisher's token

and requires an attachment: sequence number and time of sending [ns] as little-endian int64, and 16 bytes that
identify the publisher, after their number. Its releases before June 2025 wrote the names of the three before them.

zenoh-bridge-ros2dds (https://github.com/eclipse-zenoh/zenoh-plugin-ros2dds) uses the topic's name alone as the key;
the type is in the token, with slashes written as §::

    lowstate
    @/<session>/@ros2_lv/MP/lowstate/unitree_go§msg§LowState/<qos>

Both carry the message as CDR with its header of four bytes.
"""

import struct
from typing import NamedTuple

TOKENS = ("@ros2_lv/**", "@/*/@ros2_lv/**")
"""Keys under which both announce topics."""

NO_HASH = "TypeHashNotSupported"
"""ROS 2 Humble's placeholder for a type hash."""

_LABELS = (b"\x0fsequence_number", b"\x10source_timestamp", b"\x0asource_gid")
_ATTACHMENT = struct.Struct("<qqB16s")
_QOS = "::,10:,:,:,,"  # reliable, volatile, the last ten: rmw_zenoh's notation for its defaults


class Key(NamedTuple):
    """The topic described by a key or a token: ROS name with a leading slash; ROS type, such as "sensor_msgs/msg/Imu",
    empty if the key does not contain it; ROS domain, None for the bridge; and type hash as in the key.
    """

    topic: str
    kind: str = ""
    domain: int | None = None
    type_hash: str = ""


class Sent(NamedTuple):
    """Attachment of rmw_zenoh: sequence number and time of sending [ns] of a message, and its publisher."""

    sequence: int
    stamp: int
    publisher: bytes


def read_key(key: str) -> Key:
    """Parses a key of either kind."""
    parts = key.split("/")
    if len(parts) >= 4 and parts[0].isdigit() and "::dds_::" in parts[-2]:
        return Key("/" + "/".join(parts[1:-2]), ros_type(parts[-2]), int(parts[0]), parts[-1])
    return Key(f"/{key}")


def read_token(token: str) -> tuple[str, Key] | None:
    """Parses a publisher's token into key and topic; None for other tokens."""
    parts = token.split("/")
    if parts[0] == "@ros2_lv" and parts[5:6] == ["MP"] and parts[11:] and parts[1].isdigit():
        name, kind, type_hash = parts[9].replace("%", "/"), parts[10], parts[11]
        return f"{parts[1]}{name}/{kind}/{type_hash}", Key(name, ros_type(kind), int(parts[1]), type_hash)
    if parts[0] == "@" and len(parts) >= 6 and parts[2:4] == ["@ros2_lv", "MP"]:
        key = parts[4].replace("§", "/")
        return key, Key(f"/{key}", parts[5].replace("§", "/"))
    return None


def topic_key(domain: int, topic: str, kind: str, type_hash: str) -> str:
    """Key under which rmw_zenoh publishes a topic, or serves a service."""
    return f"{domain}/{topic.strip('/')}/{dds_type(kind)}/{type_hash}"


def token(domain: int, session: str, entity: int, what: str, key: str = "") -> str:
    """Token that announces our node ("NN"), or a publisher ("MP") or service ("SS") of a key, to rmw_zenoh."""
    whose = f"@ros2_lv/{domain}/{session}/0/{entity}/{what}/%/%/stadera"
    if not key:
        return whose
    _, *topic, kind, type_hash = key.split("/")
    return f"{whose}/%{'%'.join(topic)}/{kind}/{type_hash}/{_QOS}"


def read_attachment(data: bytes) -> Sent | None:
    """Parses rmw_zenoh's attachment to a message; None for other data."""
    for label in _LABELS:
        data = data.replace(label, b"", 1)
    if len(data) != _ATTACHMENT.size:
        return None
    sequence, stamp, length, publisher = _ATTACHMENT.unpack(data)
    return Sent(sequence, stamp, publisher) if length == len(publisher) else None


def attachment(sent: Sent) -> bytes:
    """Encodes the attachment that rmw_zenoh expects."""
    return _ATTACHMENT.pack(sent.sequence, sent.stamp, len(sent.publisher), sent.publisher)


def dds_type(kind: str) -> str:
    """The DDS name of a ROS type: sensor_msgs::msg::dds_::Imu_ for sensor_msgs/msg/Imu."""
    package, part, name = kind.split("/")
    return f"{package}::{part}::dds_::{name}_"


def ros_type(kind: str) -> str:
    """The ROS name of a DDS type; other types are returned unchanged."""
    return kind.removesuffix("_").replace("::dds_::", "::").replace("::", "/")
