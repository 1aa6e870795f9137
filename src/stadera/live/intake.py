"""Converts messages of a running robot to samples: decodes, synchronises and merges them, and restarts when the stream
changes.

The first messages determine which topic, publishers and columns are read, as for a bag (`stadera.logs.bags.merging`).
This is repeated when a clock was set, the rate changed, or a publisher names other joints than before.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from stadera.errors import RecordingError
from stadera.live.state import LiveSettings
from stadera.live.topics import JOINT_KINDS, KINDS, Arrival, PublisherFilter, SeenTopic, StreamClock, chosen
from stadera.logs.bags.choice import Choice
from stadera.logs.bags.container import Decoded, Message, Topic
from stadera.logs.bags.decode import IMU, Decoder, decoder
from stadera.logs.bags.merging import Merging
from stadera.logs.bags.unitree import LOW_STATES
from stadera.logs.batches import recordings
from stadera.logs.columns import Layout
from stadera.logs.recording import Recording
from stadera.logs.topics import AS_RECORDED, ReadOptions, Topics
from stadera.robot.model import Robot
from stadera.types import Array

_SOURCE = "live"


class Intake:
    """Receives messages for a robot's joints: of the requested topics, None for those that match by type.

    Attributes:
        topics: the topics read; None before they are determined.
        seen: by name, every topic with a message. announced: by name, types of topics that are known to exist.
        fresh: True if the next samples do not continue the previous ones, and may have another rate.
        lost: numbers of skipped messages and rows, by reason. notes: events, one sentence each.
    """

    def __init__(
        self,
        robot: Robot,
        topics: Topics | None = None,
        settings: LiveSettings | None = None,
        reading: ReadOptions = AS_RECORDED,
    ) -> None:
        others = () if robot.extra is None else robot.extra.joints
        reading.refuse_time("live")
        self._reading = replace(reading, others=others)
        self._robot, self._settings, asked = robot, settings or LiveSettings(), topics or Topics()
        self._asked = Topics(*(name if name is None else f"/{name.lstrip('/')}" for name in (asked.joint, asked.imu)))
        self.topics: Choice | None = None
        self.seen: dict[str, SeenTopic] = {}
        self.announced: Mapping[str, str] = {}
        self.fresh = True
        self.clock = StreamClock(self._settings)
        self.lost: Counter[str] = Counter()
        self.notes: dict[str, None] = {}
        self._decoders: dict[str, Decoder] = {}
        self._publishers = PublisherFilter(self._settings)
        self._head: list[tuple[Arrival, Decoded]] = []
        self._merging: Merging | None = None
        self._layout: Layout | None = None
        self._fault = ""
        self._progress = 0.0  # arrival of the last message that completed a sample
        self._known_joints = 0.0  # arrival of the last message of a known publisher
        self._last, self._period = np.nan, np.nan
        self._slower = 0

    def take(self, arrival: Arrival) -> None:
        """Processes a message; messages of other types are only counted."""
        seen = self.seen.setdefault(arrival.topic, SeenTopic(arrival.kind))
        seen.take(arrival)
        if arrival.kind not in KINDS or not self._wanted(arrival.topic, arrival.kind):
            return
        if (sample := self._decoded(arrival)) is None:
            return
        if not self._publishers.accepts(arrival, sample.columns):
            self.lost["left out"] += 1
            self.notes[f"a second publisher on {arrival.topic} is left out"] = None
        elif self._merging is None or self.topics is None:
            self._head.append((arrival, sample))
            self._begin()
        elif sample.topic in (self.topics.joint, self.topics.imu):
            steps = self.clock.steps
            self._merge(sample, arrival.arrived, self._merging)
            if self.clock.steps > steps:
                self.notes["the clock of the stamps was set, or a publisher began anew"] = None
                self._anew()

    def completed(self) -> Recording | None:
        """Samples completed since the last call; None if there are none."""
        if self._merging is None or self._layout is None:
            return None
        try:
            rows = self._rows(self._merging)
            found = list(recordings([rows], self._layout, _SOURCE, None, fewest=1)) if rows is not None else []
        except RecordingError as error:
            self._anew(str(error))
            return None
        if not found:
            return None
        self._progress = self._known_joints
        self._watch_rate(found[0].time)
        return found[0]

    def waiting_for(self, now: float) -> tuple[str, ...]:
        """Reasons why no samples arrive, one sentence each; empty while they do. `now` is on the clock of the arrivals
        [s].
        """
        if self._merging is None or self.topics is None:
            return (self._fault or self._lacking(),)
        chosen = [name for name in (self.topics.joint, self.topics.imu) if name is not None]
        silent = [name for name in chosen if now - self.seen[name].last > self._settings.silent]
        if silent:
            return tuple(f"messages of {name}, which have stopped" for name in silent)
        if now - self._progress <= self._settings.silent:
            return ()
        newest = max(track.newest for track in self._merging.tracks)
        behind = [t.name for t in self._merging.tracks if newest - t.newest > 1e9 * self._settings.bags.patience]
        return (f"messages of {' and '.join(behind)}" if behind else "stamps that go on, and values in all messages",)

    @property
    def losses(self) -> dict[str, int]:
        """Numbers of lost and skipped messages and rows, by reason."""
        topics = self.seen.values()
        return {
            "network": self.lost["network"] + sum(topic.lost for topic in topics),
            "damaged": sum(topic.damaged for topic in topics),
            "left out": self.lost["left out"],
        }

    # -- inside -----------------------------------------------------------------------------------------------
    def _wanted(self, topic: str, kind: str) -> bool:
        asked = self._asked.imu if kind == IMU else self._asked.joint
        return asked in (None, topic)

    def _decoded(self, arrival: Arrival) -> Decoded | None:
        name = arrival.topic
        if name not in self._decoders:
            self._decoders[name] = decoder(Topic(arrival.kind), "cdr", self._robot.tree.joints, self._settings.bags)
        try:
            return self._decoders[name]([Message(name, arrival.received, arrival.data)])[0]
        except Exception:  # the libraries raise many kinds of errors on damaged bytes
            self.seen[name].damaged += 1
            return None

    def _begin(self) -> None:
        if not _is_enough([arrival for arrival, _ in self._head], self._settings.head):
            del self._head[: -20 * self._settings.head]
            return
        head, self._head = self._head, []
        try:
            topics = chosen([arrival for arrival, _ in head], self._asked, self._robot.tree.joints, self._settings)
            head = [(arrival, sample) for arrival, sample in head if sample.topic in (topics.joint, topics.imu)]
            merging = self._merging_of([sample for _, sample in head], topics)
        except RecordingError as error:
            self._fault = str(error)
            return
        self.topics, self._merging, self._fault = topics, merging, ""
        self.fresh, self._slower = True, 0
        self._period = self._last = np.nan
        self._progress = self._known_joints = head[-1][0].arrived
        for arrival, sample in head:
            self._merge(sample, arrival.arrived, merging)

    def _merging_of(self, head: Sequence[Decoded], topics: Choice) -> Merging:
        """The merging of messages into rows, determined from the first messages of the chosen topics."""
        joints = self._robot.tree.joints
        merging = Merging(head, topics, (*joints, *self._reading.others), self._settings.bags)
        if merging.imu_fault:
            raise RecordingError(f"topic {topics.imu} cannot be used as IMU: {merging.imu_fault}")
        if self._reading.pd is None and not any(name.endswith(".effort") for name in merging.columns):
            raise RecordingError(f"{topics.joint}: its messages have no torques (effort), by which a robot is weighed")
        self._layout = merging.layout(_SOURCE, joints, ("velocity", "effort", "imu"), self._reading)
        stamps = [int(sample.stamp[0]) for sample in head if sample.topic == topics.joint]
        rate, least = 1e9 / max(float(np.median(np.diff(stamps))), 1.0), self._settings.least_rate
        if rate < least / 1.02:
            raise RecordingError(
                f"{topics.joint}: {rate:.3g} messages a second, of which weighing in motion sees too little; "
                f"{least:g} are needed"
            )
        return merging

    def _merge(self, sample: Decoded, arrived: float, merging: Merging) -> None:
        stamp = self.clock.at(sample.topic, int(sample.stamp[0]), arrived)
        if stamp is None:
            self.lost["left out"] += 1
            self.notes[f"messages of {sample.topic} on another clock are left out"] = None
        elif merging.take(sample._replace(stamp=np.array([stamp]))):
            if self.topics is not None and sample.topic == self.topics.joint:
                self._known_joints = arrived
        else:
            self.lost["left out"] += 1
            if arrived - self._known_joints > self._settings.other_publisher:
                self.notes[f"messages of {sample.topic} name other joints than before"] = None
                self._anew()

    def _anew(self, fault: str = "") -> None:
        self._merging, self._fault, self._head = None, fault, []

    def _rows(self, merging: Merging) -> Array | None:
        """Complete rows; None if there are none."""
        before = sum(track.out_of_order for track in merging.tracks)
        batch = merging.batch()
        self.lost["left out"] += sum(track.out_of_order for track in merging.tracks) - before
        for track in merging.tracks:
            if track.clock.silent:
                self.notes[f"the stamps of {track.name} repeat or run back: times of arrival are used"] = None
        if batch is None:
            return None
        complete = np.isfinite(batch).all(axis=0)
        self.lost["left out"] += int(np.count_nonzero(~complete))
        return batch[:, complete] if complete.any() else None

    def _watch_rate(self, time: Array) -> None:
        """Counts missing samples, and restarts if the rate has changed."""
        steps = np.diff(time, prepend=self._last)
        steps = steps[np.isfinite(steps)]  # none before the first sample
        self._last = float(time[-1])
        if not len(steps):
            return
        if np.isnan(self._period):
            self._period = float(np.median(steps))
        usual = steps[steps < self._settings.silent]
        if self.topics is not None and not self.seen[self.topics.joint].numbered:
            lost = usual[usual > self._settings.lost * self._period]
            self.lost["network"] += int((np.round(lost / self._period) - 1).sum())
        ratio = float(np.median(usual)) / self._period if len(usual) else 1.0
        other = not 1 / self._settings.rate_change < ratio < self._settings.rate_change
        self._slower = (self._slower + len(steps)) * other
        if self._slower > self._settings.head:
            self.notes["messages come at another rate than before"] = None
            self._anew()

    def _lacking(self) -> str:
        came = {seen.kind for name, seen in self.seen.items() if self._wanted(name, seen.kind)}
        if not came.intersection(JOINT_KINDS):
            return self._none_of("joint states", self._asked.joint, " or ".join(JOINT_KINDS[:2]))
        if not came.intersection((IMU, *LOW_STATES)):
            return self._none_of("an IMU", self._asked.imu, IMU)
        broken = (name for name, seen in self.seen.items() if seen.kind in KINDS and seen.damaged == seen.count)
        if (name := next(broken, None)) is not None:
            return f"messages of {name} that are a {self.seen[name].kind}"
        return "enough messages to begin with"

    def _none_of(self, what: str, asked: str | None, usual: str) -> str:
        there = {**self.announced, **{name: seen.kind for name, seen in self.seen.items()}}
        seen = ", ".join(f"{name} ({kind or 'type unknown'})" for name, kind in sorted(there.items())) or "none"
        on = f" on {asked}" if asked else ""
        return f"{what}{on}: no messages of {usual} yet; topics seen: {seen}"


def _is_enough(head: Sequence[Arrival], fewest: int) -> bool:
    counts = Counter((arrival.topic, arrival.kind) for arrival in head)
    of_joints = [n for (_, kind), n in counts.items() if kind in JOINT_KINDS]
    has_imu = any(kind in LOW_STATES or (kind == IMU and n > 1) for (_, kind), n in counts.items())
    return max(of_joints, default=0) >= fewest and has_imu
