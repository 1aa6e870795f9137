"""Messages decoded several at once are those decoded one by one, whatever came before."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import bags
from bags import IMU, JOINT_STATE, TYPES, Sent
from stadera.logs.bags.container import BagSettings, Decoded, Message, Topic
from stadera.logs.bags.decode import decoder
from stadera.logs.bags.unitree import LOW_STATES, LowStates

RNG = np.random.default_rng(0)


def of_one(samples: list[Decoded]) -> tuple[tuple[object, ...], np.ndarray]:
    """What is not an array or has one element, and the values of the only message."""
    (found,) = samples
    return (found.topic, *found.received, *found.stamp, found.frame, found.columns), found.values[0]


def compared(sent: list[Sent], kind: str) -> Iterator[tuple[str, np.ndarray]]:
    """Each message by a decoder that has seen the ones before, against one that has seen none."""
    practised = decoder(Topic(kind), "cdr", None, BagSettings())
    for one in sent:
        message = Message(one.topic, one.received, one.data)
        (fresh, expected), (found, values) = map(
            of_one, (decoder(Topic(kind), "cdr", None, BagSettings())([message]), practised([message]))
        )
        assert found == fresh
        np.testing.assert_array_equal(values, expected)
        yield str(found[3]), values


PUBLISHED = st.lists(st.text("abc_é", min_size=1, max_size=9), min_size=0, max_size=5, unique=True)


@settings(max_examples=60, deadline=None)
@given(st.lists(st.tuples(PUBLISHED, st.booleans(), st.booleans()), min_size=2, max_size=4))
def test_joint_states_of_changing_publishers(messages: list[tuple[list[str], bool, bool]]) -> None:
    sent = []
    for k, (names, with_velocity, twice) in enumerate(messages):
        for repeat in range(1 + twice):
            row = RNG.normal(size=(3, len(names)))
            velocity = row[1] if with_velocity else ()
            sent.append(bags.joints(k + 0.1 * repeat + 0.001, names, row[0], velocity, row[2]))
    assert len(list(compared(sent, JOINT_STATE))) == len(sent)


@pytest.mark.parametrize("known", [(True, True, True), (False, True, True), (True, False, True), (True, True, False)])
def test_imus(known: tuple[bool, ...]) -> None:
    sent = [
        bags.imu(0.01 * k, RNG.normal(size=3), RNG.normal(size=3), turn, known=known, frame=frame)
        for k, (frame, turn) in enumerate(
            [("imu", (0, 0, 0, 1)), ("imu", (0, 0, 0, 0)), ("", (0, 1, 0, 0)), ("a_b", (1, 0, 0, 0))]
        )
        for _ in range(2)
    ]
    found = list(compared(sent, IMU))
    assert [frame for frame, _ in found[::2]] == ["imu", "imu", "", "a_b"]
    assert np.isnan(found[3][1][6:]).all()


def test_the_other_byte_order_and_what_is_cut_off() -> None:
    sent = bags.joints(1.0, ["a", "b"], [1.0, 2.0], [3.0, 4.0], [5.0, 6.0])
    content = TYPES.deserialize_cdr(sent.data, JOINT_STATE)
    big = sent._replace(data=bytes(TYPES.serialize_cdr(content, JOINT_STATE, little_endian=False)))
    assert len(list(compared([sent, sent, big, sent, sent], JOINT_STATE))) == 5
    practised = decoder(Topic(JOINT_STATE), "cdr", None, BagSettings())
    practised([Message("", 0, sent.data)])
    with pytest.raises(Exception):  # noqa: B017, PT011  of whatever kind rosbags meets it with
        practised([Message("", 0, sent.data[:-8])])


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


@pytest.mark.parametrize(("make", "kind"), [(joint_states, JOINT_STATE), (imus, IMU), (low_states, LOW_STATES[0])])
def test_several_at_once_are_those_one_by_one(make: Callable[[], list[Sent]], kind: str) -> None:
    messages = [Message(one.topic, one.received, one.data) for one in make()]
    alone, together = (decoder(Topic(kind), "cdr", None, BagSettings()) for _ in range(2))
    expected = [samples for message in messages for samples in alone([message])]
    found = [
        samples
        for part in (slice(0, 8), slice(8, 9), slice(9, 25), slice(25, COUNT))
        for samples in together(messages[part])
    ]
    assert len(found) == 4
    for one in found:
        assert (one.topic, one.frame, one.columns) == (expected[0].topic, expected[0].frame, expected[0].columns)
    for name in ("received", "stamp", "values"):
        several, each = (np.concatenate([getattr(one, name) for one in part]) for part in (found, expected))
        np.testing.assert_array_equal(several, each)
    if isinstance(alone, LowStates):
        assert isinstance(together, LowStates)
        assert list(alone.notes("/low")) == list(together.notes("/low"))


def test_messages_of_another_layout_in_between() -> None:
    sent = joint_states()
    sent[20:23] = [bags.joints(7.0 + k, NAMES[::-1], *RNG.normal(size=(3, 12))) for k in range(20, 23)]
    messages = [Message(one.topic, one.received, one.data) for one in sent]
    alone, together = (decoder(Topic(JOINT_STATE), "cdr", None, BagSettings()) for _ in range(2))
    found, expected = together(messages), [samples for message in messages for samples in alone([message])]
    rows = [(one.columns, row.tolist()) for one in found for row in one.values]
    assert rows == [(one.columns, row.tolist()) for one in expected for row in one.values]
    assert len(found) == 3
