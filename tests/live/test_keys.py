"""Keys, tokens and attachments, as the documents of rmw_zenoh and the source of zenoh-bridge-ros2dds show them."""

from __future__ import annotations

import struct

import pytest

from bags import TYPES
from stadera.live import keys, messages
from stadera.live.keys import Key, Sent

STRING = "std_msgs/msg/String"
HASH = "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"
CHATTER = f"0/robot1/chatter/std_msgs::msg::dds_::String_/{HASH}"  # rmw_zenoh, docs/design.md
SESSION = "8b20917502ee955ac4476e0266340d5c"
TALKER = f"@ros2_lv/2/{SESSION}/0/10/MP/%/%/talker/%chatter/std_msgs::msg::dds_::String_/{HASH}/::,7:,:,:,,"


def test_a_key_of_rmw_zenoh() -> None:
    assert keys.read_key(CHATTER) == Key("/robot1/chatter", STRING, 0, HASH)
    assert keys.topic_key(0, "/robot1/chatter", STRING, messages.type_hash(STRING)) == CHATTER
    assert keys.read_key("robot/lowstate") == Key("/robot/lowstate")


def test_tokens() -> None:
    assert keys.read_token(TALKER) == (CHATTER.replace("0/robot1", "2", 1), Key("/chatter", STRING, 2, HASH))
    assert keys.read_token(TALKER.replace("MP", "MS")) is None
    bridged = "@/14d8d99a620bd7339c0bea08046aba8/@ros2_lv/MP/ns§lowstate/unitree_go§msg§LowState/:::1,1"
    assert keys.read_token(bridged) == ("ns/lowstate", Key("/ns/lowstate", "unitree_go/msg/LowState"))
    assert keys.read_token(bridged.replace("MP", "SS")) is None
    assert keys.read_token("@/x") is None
    own = keys.token(2, "abc", 3, "MP", keys.topic_key(2, "/chatter", STRING, HASH))
    assert keys.read_token(own) == (CHATTER.replace("0/robot1", "2", 1), Key("/chatter", STRING, 2, HASH))


def test_attachments_of_old_and_new_releases() -> None:
    sent = Sent(5, 1_700_000_000_000_000_000, bytes(range(16)))
    new = struct.pack("<qq", 5, 1_700_000_000_000_000_000) + b"\x10" + bytes(range(16))
    labelled = b"".join(
        bytes([len(label)]) + label + value
        for label, value in ((b"sequence_number", new[:8]), (b"source_timestamp", new[8:16]), (b"source_gid", new[16:]))
    )
    assert keys.attachment(sent) == new
    assert keys.read_attachment(new) == keys.read_attachment(labelled) == sent
    assert keys.read_attachment(b"something else") is None


def test_the_hash_of_the_service() -> None:
    """REP 2016: of request, response and event, under the names that ROS gives them."""
    import hashlib
    import json

    def field(name: str, kind: int, capacity: int = 0, nested: str = "") -> dict[str, object]:
        detail = {"type_id": kind, "capacity": capacity, "string_capacity": 0, "nested_type_name": nested}
        return {"name": name, "type": detail}

    def struct_(name: str, *fields: dict[str, object]) -> dict[str, object]:
        return {"type_name": name, "fields": list(fields)}

    own, info, stamp = "std_srvs/srv/Trigger", "service_msgs/msg/ServiceEventInfo", "builtin_interfaces/msg/Time"
    parts = [
        struct_(stamp, field("sec", 6), field("nanosec", 7)),
        struct_(
            info,
            field("event_type", 3),
            field("stamp", 1, 0, stamp),
            field("client_gid", 51, 16),
            field("sequence_number", 8),
        ),
        struct_(
            f"{own}_Event",
            field("info", 1, 0, info),
            field("request", 97, 1, f"{own}_Request"),
            field("response", 97, 1, f"{own}_Response"),
        ),
        struct_(f"{own}_Request", field("structure_needs_at_least_one_member", 3)),
        struct_(f"{own}_Response", field("success", 15), field("message", 17)),
    ]
    whole = struct_(
        own, *(field(f"{part}_message", 1, 0, f"{own}_{part.title()}") for part in ("request", "response", "event"))
    )
    described = json.dumps({"type_description": whole, "referenced_type_descriptions": parts})
    assert f"RIHS01_{hashlib.sha256(described.encode()).hexdigest()}" == messages.TRIGGER_HASH


def test_an_answer_is_a_trigger_response() -> None:
    data = messages.answer_message(True, "tared")
    assert data == b"\0\1\0\0" + b"\1\0\0\0" + struct.pack("<I", 6) + b"tared\0" or data.startswith(
        b"\0\1\0\0\1\0\0\0\6\0\0\0tared\0"
    )


@pytest.mark.parametrize("kind", [messages.INERTIA, messages.DIAGNOSTICS, messages.STRING])
def test_hashes_of_messages_are_those_of_the_definitions(kind: str) -> None:
    assert messages.type_hash(kind) == TYPES.hash_rihs01(kind)
