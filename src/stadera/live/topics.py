"""The topics of a running robot: what was seen of each, and which of them are taken in."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

from stadera.errors import RecordingError
from stadera.live.keys import Sent
from stadera.live.settings import LiveSettings
from stadera.logs.bags.beginning import chosen_topics, joints_in
from stadera.logs.bags.container import Topic
from stadera.logs.bags.decode import IMU, JOINT_STATE, Sample
from stadera.logs.bags.unitree import LOW_STATES
from stadera.logs.topics import Topics

JOINT_KINDS = (JOINT_STATE, *LOW_STATES)
KINDS = (*JOINT_KINDS, IMU)
"""Types that are read."""

_MORE_OFTEN = 2.0  # times as many messages: the topic is meant, and the other one a slower copy


class Arrival(NamedTuple):
    """A message as it arrived.

    Attributes:
        topic, kind: ROS name and type.
        received: when it was sent, where that is known, else when it arrived [ns].
        data: CDR.
        arrived: by this machine's steady clock [s].
        sent: its attachment; None where it has none.
    """

    topic: str
    kind: str
    received: int
    data: bytes
    arrived: float
    sent: Sent | None = None


@dataclass
class SeenTopic:
    """What was seen of a topic.

    Attributes:
        kind: ROS type. count: messages. lost: messages that were sent and did not arrive, by their numbers.
        last: arrival of the newest [s]. rate: messages a second, over the last second. numbered: whether they are.
    """

    kind: str
    count: int = 0
    lost: int = 0
    last: float = 0.0
    rate: float = 0.0
    _since: tuple[float, int] = (0.0, 0)
    numbered: bool = False
    _numbers: dict[bytes, int] = field(default_factory=dict)

    def take(self, arrival: Arrival) -> None:
        """Counts a message."""
        if self.count == 0:
            self._since = arrival.arrived, 0
        self.count, self.last = self.count + 1, arrival.arrived
        if (sent := arrival.sent) is not None:
            missed = sent.sequence - self._numbers.get(sent.publisher, sent.sequence - 1) - 1
            self.numbered = True
            self.lost += max(missed, 0)  # a publisher that begins anew counts anew
            self._numbers[sent.publisher] = sent.sequence

    def look(self, now: float) -> float:
        """The rate [Hz], as it is now."""
        begun, before = self._since
        if now - begun >= 1.0:
            self.rate, self._since = (self.count - before) / (now - begun), (now, self.count)
        return self.rate


class PublisherFilter:
    """Keeps to one publisher of the same columns on a topic, as long as its messages come."""

    def __init__(self, settings: LiveSettings) -> None:
        self._patience = settings.other_publisher
        self._current: dict[tuple[str, frozenset[str]], tuple[bytes, float]] = {}

    def accepts(self, arrival: Arrival, columns: tuple[str, ...]) -> bool:
        """Whether a message is of the publisher that is listened to. One without an attachment always is."""
        if arrival.sent is None:
            return True
        what = arrival.topic, frozenset(columns)
        publisher, last = self._current.get(what, (arrival.sent.publisher, 0.0))
        if publisher != arrival.sent.publisher and arrival.arrived - last < self._patience:
            return False
        self._current[what] = arrival.sent.publisher, arrival.arrived
        return True


def choose(head: Sequence[Sample], kinds: Mapping[str, str], asked: Topics, joints: Sequence[str]) -> Topics:
    """The topic of joints, and the IMU's, None where the joints' messages have one or there is none.

    Of several topics of joints, the one that names most of the robot's; of equal ones a LowState, which has an IMU;
    then the one with twice as many messages.

    Raises:
        RecordingError: several that are alike and none asked for; one asked for that is not there or of another type.
    """
    found = {sample.topic: Topic(kinds[sample.topic]) for sample in head}
    joint = asked.joint or _best(head, found, joints)
    left = {name: topic for name, topic in found.items() if topic.kind == IMU or joint in (None, name)}
    return Topics(*chosen_topics(left, Topics(joint, asked.imu), "live"))


def _best(head: Sequence[Sample], found: Mapping[str, Topic], joints: Sequence[str]) -> str | None:
    """The topic of joints that is meant; None of several that are alike, and of none."""
    ranks: dict[str, tuple[int, bool, int]] = {}
    for name, topic in found.items():
        if topic.kind in JOINT_KINDS:
            samples = [sample for sample in head if sample.topic == name]
            named = {joint for columns in {s.columns for s in samples} for joint in joints_in(columns)}
            ranks[name] = len(named.intersection(joints)), topic.kind in LOW_STATES, len(samples)
    if not ranks:
        return None
    first, *others = sorted(ranks, key=lambda name: ranks[name], reverse=True)
    rivals = [name for name in others if ranks[name][:2] == ranks[first][:2]]
    if any(_MORE_OFTEN * ranks[name][2] > ranks[first][2] for name in rivals):
        listed = ", ".join(sorted([first, *rivals]))
        raise RecordingError(f"several topics of {found[first].kind}: {listed}; choose one with --joint-topic")
    return first
