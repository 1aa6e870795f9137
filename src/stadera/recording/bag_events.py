"""The messages of a bag that make a log: which topics they are on, and what they say."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from typing import NamedTuple

from stadera.errors import RecordingError
from stadera.recording.bag import Bag
from stadera.recording.ros_messages import IMU, JOINT_STATE, ImuState, JointState, imu_state, joint_state
from stadera.recording.topics import Topics


class Event(NamedTuple):
    """A message.

    Attributes:
        received: when it was recorded [ns].
        state: what it says.
    """

    received: int
    state: JointState | ImuState


class BagEvents:
    """The messages of a topic of joints and one of an IMU, as recorded; those that are damaged are counted.

    Attributes:
        damaged: by topic, messages that could not be read.
    """

    def __init__(self, bag: Bag, joint_topic: str, imu_topic: str | None) -> None:
        self.damaged: Counter[str] = Counter()
        self._joint_topic = joint_topic
        self._messages = bag.messages({joint_topic} if imu_topic is None else {joint_topic, imu_topic})

    def __iter__(self) -> Iterator[Event]:
        for topic, received, data in self._messages:
            try:
                state = joint_state(data, topic) if topic == self._joint_topic else imu_state(data, topic)
            except RecordingError:
                self.damaged[topic] += 1
            else:
                yield Event(received, state)


def chosen_topics(types: Mapping[str, str], topics: Topics, source: str) -> tuple[str, str | None]:
    """The topic of joints and that of the IMU, None where there is none.

    Args:
        types: of the bag's messages, by topic.
        topics: what was asked for.
        source: the bag, for messages.

    Raises:
        RecordingError: a topic that is not there or of another type, none of joints, several and none chosen.
    """
    joint = _chosen(types, JOINT_STATE, topics.joint, "--joint-topic", source)
    if joint is None:
        there = ", ".join(f"{topic} ({kind})" for topic, kind in sorted(types.items())) or "none"
        raise RecordingError(f"{source}: no topic of type {JOINT_STATE}; topics: {there}")
    return joint, _chosen(types, IMU, topics.imu, "--imu-topic", source)


def _chosen(types: Mapping[str, str], kind: str, asked: str | None, option: str, source: str) -> str | None:
    fitting = sorted(topic for topic, its in types.items() if its == kind)
    listed = ", ".join(fitting) or "none"
    if asked is not None:
        if asked not in types:
            raise RecordingError(f"{source}: {option} {asked}: no such topic; topics of type {kind}: {listed}")
        if asked not in fitting:
            raise RecordingError(f"{source}: {option} {asked} is a {types[asked]}; topics of type {kind}: {listed}")
        return asked
    if len(fitting) > 1:
        raise RecordingError(f"{source}: several topics of type {kind}: {listed}; choose one with {option}")
    return fitting[0] if fitting else None
