"""Messages decoded several at once are those decoded one by one; chunks of MCAP split here are those of the library."""

from __future__ import annotations

import zlib
from collections.abc import Callable
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
from mcap.opcode import Opcode
from mcap.records import Message as Stored
from mcap.stream_reader import StreamReader, breakup_chunk

import bags
from bags import IMU, JOINT_STATE, Sent
from stadera.errors import RecordingError
from stadera.logs.bags.clock import TickClock
from stadera.logs.bags.container import Message, Messages, Topic
from stadera.logs.bags.decode import decoder
from stadera.logs.bags.mcap_chunk import Pieces, split
from stadera.logs.bags.settings import DEFAULTS
from stadera.logs.bags.unitree import LOW_STATES

RNG = np.random.default_rng(0)
COUNT = 40
NAMES = [f"joint_{k}" for k in range(12)]


def joint_states() -> list[Sent]:
    return [
        bags.joints(5.0 + 0.002 * k, NAMES, *RNG.normal(size=(3, 12)), received=5.1 + 0.002 * k) for k in range(COUNT)
    ]


def imus() -> list[Sent]:
    turns = [(0, 0, 0, 1) if k % 3 else (0, 0, 0, 0) for k in range(COUNT)]
    known = [(True, bool(k % 5), bool(k % 7)) for k in range(COUNT)]
    return [bags.imu(0.002 * k, *RNG.normal(size=(2, 3)), turns[k], known=known[k]) for k in range(COUNT)]


def low_states() -> list[Sent]:
    """With ticks that repeat, wrap around and restart, and a recorder's clock that steps."""
    ticks = (2**32 - 20_000 + 2 * np.arange(COUNT)).tolist()
    ticks[10:12] = [ticks[9]] * 2
    ticks[20:] = (2**32 - 5 + 2 * np.arange(COUNT - 20)).tolist()
    ticks[35:] = (2 * np.arange(COUNT - 35)).tolist()
    times = 5.0 + 0.002 * np.arange(COUNT) + np.abs(RNG.normal(0.0, 1e-3, COUNT))
    times[30:] += 3.0
    return [
        bags.low_state(float(t), *RNG.normal(size=(3, 12)), tick=tick) for t, tick in zip(times, ticks, strict=True)
    ]


def at_once(sent: list[Sent]) -> Messages:
    data = np.array([np.frombuffer(one.data, np.uint8) for one in sent])
    return Messages(sent[0].topic, np.array([one.received for one in sent]), data)


@pytest.mark.parametrize(("make", "kind"), [(joint_states, JOINT_STATE), (imus, IMU), (low_states, LOW_STATES[0])])
def test_several_at_once_are_those_one_by_one(make: Callable[[], list[Sent]], kind: str) -> None:
    sent = make()
    alone, together = (decoder(Topic(kind), "cdr", None, DEFAULTS) for _ in range(2))
    expected = [alone(Message(one.topic, one.received, one.data)) for one in sent]
    together(Message(sent[0].topic, sent[0].received, sent[0].data))
    for part in (slice(1, 8), slice(8, 9), slice(9, 25), slice(25, COUNT)):
        found = together.many(at_once(sent[part]))
        assert found is not None
        assert (found.topic, found.frame, found.columns) == (expected[0].topic, expected[0].frame, expected[0].columns)
        np.testing.assert_array_equal(found.received, [sample.received for sample in expected[part]])
        np.testing.assert_array_equal(found.stamp, [sample.stamp for sample in expected[part]])
        np.testing.assert_array_equal(found.values, [sample.values for sample in expected[part]])
    if kind in LOW_STATES:
        assert list(alone.notes("/low")) == list(together.notes("/low"))  # type: ignore[attr-defined]


def test_messages_of_another_layout_are_not_read_at_once() -> None:
    sent, others = joint_states(), [bags.joints(9.0, NAMES[::-1], *RNG.normal(size=(3, 12))) for _ in range(3)]
    decode = decoder(Topic(JOINT_STATE), "cdr", None, DEFAULTS)
    assert decode.many(at_once(sent[:3])) is None  # none seen before
    decode(Message(sent[0].topic, 0, sent[0].data))
    assert decode.many(at_once(sent[1:3])) is not None
    assert decode.many(at_once([sent[3], others[0]])) is None


def test_ticks_at_once_are_those_one_by_one() -> None:
    """Over random delays, with stamps that the counter corrects."""
    received = np.cumsum(RNG.integers(1_000_000, 3_000_000, 3000)) + RNG.integers(0, 8_000_000, 3000)
    ticks = np.cumsum(RNG.integers(1, 4, 3000)) + 2**32 - 3000
    one, several = TickClock(), TickClock()
    expected = [one.stamp(int(r), int(t) % 2**32) for r, t in zip(received, ticks, strict=True)]
    found = [several.stamps(received[k : k + 250], ticks[k : k + 250] % 2**32) for k in range(0, 3000, 250)]
    np.testing.assert_array_equal(np.concatenate(found), expected)
    assert list(one.notes("")) == list(several.notes(""))
    assert one.repaired > 1000


def chunk_of(sent: list[Sent], tmp_path: Path) -> bytes:
    path = bags.write_mcap(sent, tmp_path / "log.mcap", chunk=1 << 22, compression=bags.CompressionType.NONE)
    chunks = [
        r for r in StreamReader(BytesIO(path.read_bytes()), emit_chunks=True).records if hasattr(r, "uncompressed_crc")
    ]
    assert len(chunks) == 1
    records = [r for r in breakup_chunk(chunks[0]) if isinstance(r, Stored)]
    found = split(chunks[0].data, chunks[0].uncompressed_crc)
    topics = {r.id: r.topic for r in found if hasattr(r, "topic")}
    messages = [m for piece in found if isinstance(piece, Pieces) for m in piece.of(topics).each()]
    for topic in topics.values():
        own = [(r.log_time, r.data) for r in records if topics[r.channel_id] == topic]
        assert [(m.received, m.data) for m in messages if m.topic == topic] == own
    assert len(messages) == len(records)
    return bytes(chunks[0].data)


def test_chunks_are_split_as_by_the_library(tmp_path: Path) -> None:
    sent = sorted([*joint_states(), *imus(), *[bags.text(0.01 * k) for k in range(9)]], key=lambda one: one.received)
    data = chunk_of(sent * 60, tmp_path)  # more than are kept in a piece
    with pytest.raises(RecordingError, match="crc validation failed"):
        split(data, zlib.crc32(data) ^ 1)
    with pytest.raises(RecordingError, match="a record is not within its chunk"):
        split(data[:-1], 0)
    short = bytes([Opcode.MESSAGE]) + (21).to_bytes(8, "little") + bytes(21)
    with pytest.raises(RecordingError, match="a record is not within its chunk"):
        split(short, 0)
