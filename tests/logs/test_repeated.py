"""Messages read by the places of their numbers are those that rosbags reads field by field."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import bags
from bags import IMU, JOINT_STATE, TYPES, Sent
from stadera.logs.bags.container import Message, Topic
from stadera.logs.bags.decode import decoder
from stadera.logs.bags.settings import DEFAULTS

RNG = np.random.default_rng(0)


def compared(sent: list[Sent], kind: str) -> Iterator[tuple[str, np.ndarray]]:
    """Each message by a decoder that has seen the ones before, against one that has seen none."""
    practised = decoder(Topic(kind), "cdr", None, DEFAULTS)
    for one in sent:
        message = Message(one.topic, one.received, one.data)
        fresh, found = decoder(Topic(kind), "cdr", None, DEFAULTS)(message), practised(message)
        assert found[:5] == fresh[:5]
        np.testing.assert_array_equal(found.values, fresh.values)
        yield found.frame, found.values


NAMES = st.lists(st.text("abc_é", min_size=1, max_size=9), min_size=0, max_size=5, unique=True)


@settings(max_examples=60, deadline=None)
@given(st.lists(st.tuples(NAMES, st.booleans(), st.booleans()), min_size=2, max_size=4))
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
    practised = decoder(Topic(JOINT_STATE), "cdr", None, DEFAULTS)
    practised(Message("", 0, sent.data))
    with pytest.raises(Exception):  # noqa: B017, PT011  of whatever kind rosbags meets it with
        practised(Message("", 0, sent.data[:-8]))
