"""Topics of a running robot: statistics of each, the choice of those to read, and their one clock."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

from stadera.live.keys import Sent
from stadera.live.state import LiveSettings
from stadera.logs.bags.choice import Choice, Offer, choose
from stadera.logs.bags.container import Message, Topic
from stadera.logs.bags.decode import IMU, JOINT_STATE
from stadera.logs.bags.unitree import LOW_STATES
from stadera.logs.topics import Topics

NS = 1_000_000_000
JOINT_KINDS = (JOINT_STATE, *LOW_STATES)
KINDS = (*JOINT_KINDS, IMU)
"""Types that are read."""


class Arrival(NamedTuple):
    """A message as it arrived."""

    # topic, kind: ROS name and type
    topic: str
    kind: str
    received: int  # time of sending if known, else of arrival [ns]
    data: bytes  # CDR
    arrived: float  # on this machine's monotonic clock [s]
    sent: Sent | None = None  # its attachment; None without one


@dataclass
class SeenTopic:
    """Statistics of a topic: its messages, unreadable ones, and those lost, sent but not arrived by their sequence
    numbers if they are `numbered`; arrival of the newest [s], and messages a second, over the last second.
    """

    kind: str
    count: int = 0
    damaged: int = 0
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
            self.lost += max(missed, 0)  # a restarted publisher restarts its numbers
            self._numbers[sent.publisher] = sent.sequence

    def look(self, now: float) -> float:
        """The present rate [Hz]."""
        begun, before = self._since
        if now - begun >= 1.0:
            self.rate, self._since = (self.count - before) / (now - begun), (now, self.count)
        return self.rate


class PublisherFilter:
    """Accepts one publisher for each set of columns on a topic, as long as its messages arrive."""

    def __init__(self, settings: LiveSettings) -> None:
        self._patience = settings.other_publisher
        self._current: dict[tuple[str, frozenset[str]], tuple[bytes, float]] = {}

    def accepts(self, arrival: Arrival, columns: tuple[str, ...]) -> bool:
        """True if a message is from the accepted publisher. One without an attachment is always accepted."""
        if arrival.sent is None:
            return True
        what = arrival.topic, frozenset(columns)
        publisher, last = self._current.get(what, (arrival.sent.publisher, 0.0))
        if publisher != arrival.sent.publisher and arrival.arrived - last < self._patience:
            return False
        self._current[what] = arrival.sent.publisher, arrival.arrived
        return True


def chosen(head: Sequence[Arrival], asked: Topics, joints: Sequence[str], settings: LiveSettings) -> Choice:
    """Chooses the topics of joints and IMU (None if the joints' messages include it or there is none), as for a bag.
    Raises RecordingError: several match and none was requested, or the requested one is missing or has another type.
    """

    def first(topics: Sequence[str]) -> Iterator[Message]:
        return (Message(one.topic, one.received, one.data) for one in head if one.topic in topics)

    offer = Offer("live", "cdr", {arrival.topic: Topic(arrival.kind) for arrival in head}, first, whole=False)
    return choose(offer, asked, joints, settings.bags)


@dataclass
class _Heard:
    """State of a topic: newest stamp [ns], arrival of its last message on the clock [s], largest stamp minus arrival
    [s].
    """

    newest: int
    arrived: float
    ahead: float


class StreamClock:
    """Keeps the stamps of a robot's topics on one clock.

    A message cannot arrive before it was measured, so stamp minus arrival exceeds its largest value so far only if the
    clock was set forwards. A stamp far behind the topic's newest indicates that the clock was set back, or that the
    publisher restarted. Messages off the clock are skipped as those of a second publisher, unless messages on it have
    stopped: then the clock continues with them, shifted by the difference in arrival, for all topics alike.

    Attributes:
        shift: added to stamps [ns]. steps: number of times the clock was set.
    """

    def __init__(self, settings: LiveSettings) -> None:
        self._step, self._patience = settings.clock_step, settings.other_publisher
        self.shift = self.steps = 0
        self._heard: dict[str, _Heard] = {}

    def at(self, topic: str, stamp: int, arrived: float) -> int | None:
        """The stamp [ns] on the clock; None for a message that is off it. `arrived` is on this machine's monotonic
        clock [s].
        """
        shifted = stamp + self.shift
        heard = self._heard.setdefault(topic, _Heard(shifted, arrived, shifted / NS - arrived))
        back = shifted < heard.newest - self._step * NS
        if back or shifted / NS - arrived > heard.ahead + self._step:
            if arrived - heard.arrived < self._patience:
                return None
            self.steps += 1
            expected = heard.newest + round(NS * (arrived - heard.arrived))
            self.shift += expected - shifted
            shifted, heard.ahead = expected, expected / NS - arrived
        heard.newest, heard.arrived = max(heard.newest, shifted), arrived
        heard.ahead = max(heard.ahead, shifted / NS - arrived)
        return shifted
