"""Merges messages of joints and an IMU into rows at the joints' stamps, from a bag or a running robot.

The first messages determine which publisher provides which columns.
"""

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from stadera.errors import RecordingError
from stadera.logs.bags.alignment import Alignment, Track
from stadera.logs.bags.container import BagSettings, Decoded
from stadera.logs.bags.decode import IMU_NAMES
from stadera.logs.columns import TIME
from stadera.types import Array

Columns = tuple[str, ...]


@dataclass(frozen=True, eq=False)
class Beginning:
    """The layout of a bag, derived from its first messages. Columns are named as in the flat table."""

    # for each publisher of joints, identified by its samples' columns, the columns that ever have a value. The
    # publisher whose stamps are used comes first.
    joints: Mapping[frozenset[str], Columns]
    imu: Columns | None  # columns of the IMU's own topic; None without a usable one
    imu_frame: str | None  # frame_id of its messages, None if empty
    imu_fault: str  # why an existing IMU cannot be used; empty if it can
    # of the IMU's stamps relative to the joints', from the times of recording [s]; NaN without an IMU
    clock_offset: float

    @property
    def columns(self) -> Columns:
        """Columns of all publishers."""
        return (*(name for columns in self.joints.values() for name in columns), *(self.imu or ()))


def first_samples(
    found: Iterable[Decoded], joint_topic: str, imu_topic: str | None, settings: BagSettings
) -> tuple[Decoded, ...]:
    """The first messages: a number of joints' messages, and one of an IMU if it has a topic."""
    head: list[Decoded] = []
    counts: Counter[str | None] = Counter()
    for samples in found:
        head.append(samples)
        counts[samples.topic] += len(samples.stamp)
        whole = counts[joint_topic] >= settings.head and (imu_topic is None or counts[imu_topic] > 0)
        if whole or counts.total() >= settings.most_ahead:
            break
    return tuple(head)


def beginning_of(
    head: Iterable[Decoded], joint_topic: str, imu_topic: str | None, joints: Sequence[str] | None
) -> Beginning:
    """Derives the layout for the requested joints (None: all) from the first messages. Raises RecordingError: the
    publishers contradict each other.
    """
    of_joints = [sample for sample in head if sample.topic == joint_topic]
    of_imu = [sample for sample in head if sample.topic == imu_topic]
    offset = _delay(of_joints) - _delay(of_imu)
    fault = _fault(of_imu) if imu_topic is not None else ""
    usable = bool(of_imu) and not fault
    return Beginning(
        joints=_publishers(of_joints, joints, imu=imu_topic is None),
        imu=_known(of_imu) if usable else None,
        imu_frame=(of_imu[0].frame or None) if usable else None,
        imu_fault=fault,
        clock_offset=offset,
    )


def joints_in(columns: Iterable[str]) -> Columns:
    """Joints with a position among these columns."""
    return tuple(name.removesuffix(".position") for name in columns if name.endswith(".position"))


def _publishers(
    samples: Sequence[Decoded], joints: Sequence[str] | None, *, imu: bool
) -> dict[frozenset[str], Columns]:
    """Publishers of one topic, the one with most of the requested joints first.

    Publishers of none of these joints are skipped, unless all are. With `imu`, columns of an IMU in the same messages
    are kept.
    """
    groups = _grouped(samples)
    if not groups:
        raise RecordingError(f"{samples[0].topic}: its messages name no joints")
    named = {key: joints_in(group[0].columns) for key, group in groups.items()}
    asked = frozenset(joints or ()) & frozenset().union(*named.values())
    shared = {key: len(asked.intersection(named[key]) if asked else key) for key in groups}
    kept = sorted(filter(shared.get, groups), key=lambda key: -shared[key])
    _check_agreement([named[key] for key in groups if key in kept], samples[0].topic)
    left_out = () if imu else IMU_NAMES
    return {key: tuple(name for name in _known(groups[key]) if name not in left_out) for key in kept}


def _grouped(samples: Iterable[Decoded]) -> dict[frozenset[str], list[Decoded]]:
    """Groups samples by their columns in any order; samples without columns are skipped."""
    groups: dict[frozenset[str], list[Decoded]] = {}
    for sample in samples:
        groups.setdefault(frozenset(sample.columns), []).append(sample)
    groups.pop(frozenset(), None)
    return groups


def _check_agreement(named: Sequence[Columns], topic: str) -> None:
    """Raises if two publishers have a joint in common, or one names a joint twice."""
    for k, names in enumerate(named):
        if len(set(names)) < len(names):
            twice, _ = Counter(names).most_common(1)[0]
            raise RecordingError(f"{topic}: a message names joint {twice!r} twice")
        for other in named[:k]:
            if both := sorted(set(names).intersection(other)):
                raise RecordingError(
                    f"{topic}: joint {both[0]!r} comes in messages of {len(other)} and in messages of {len(names)} "
                    "joints: two publishers that do not agree share the topic"
                )


def _known(samples: Sequence[Decoded]) -> Columns:
    """Columns that ever have a value, for samples with the same columns in any order."""
    known = {one.columns[k] for one in samples for k in np.flatnonzero(np.isfinite(one.values).any(axis=0))}
    return tuple(name for name in samples[0].columns if name in known)


def _fault(samples: Sequence[Decoded]) -> str:
    if not samples:
        return "it has no messages that can be read"
    if other := next((sample.frame for sample in samples if sample.frame != samples[0].frame), None):
        return f"its messages are in two frames, {samples[0].frame!r} and {other!r}"
    if missing := [name for name in IMU_NAMES[:6] if name not in _known(samples)]:
        return f"it has no {missing[0].removeprefix('imu.')}"
    return ""


def _delay(samples: Sequence[Decoded]) -> float:
    """Median time from stamp to recording [s]; NaN without samples."""
    return 1e-9 * float(np.median(np.concatenate([s.received - s.stamp for s in samples]))) if samples else float("nan")


class Merging:
    """Merges one pass of messages by the layout of the first, of the joints' topic and the IMU's, None if the joints'
    messages include it, into columns of the flat table, chosen from `start.columns`, time first.

    Attributes:
        tracks: the streams; the first one's stamps are used.
        strangers: number of messages of the joints' topic that name other joints, which are skipped.
    """

    def __init__(
        self, start: Beginning, topic: str, imu_topic: str | None, columns: Sequence[str], settings: BagSettings
    ) -> None:
        self._start, self._topic = start, topic
        several = len(start.joints) > 1
        self._joints = {
            key: Track(f"{topic} ({joints_in(columns)[0]}, ...)" if several else topic, columns, settings)
            for key, columns in start.joints.items()
        }
        self._imu = Track(imu_topic, start.imu, settings) if imu_topic is not None and start.imu is not None else None
        self.tracks = (*self._joints.values(), *([] if self._imu is None else [self._imu]))
        self._alignment = Alignment(self.tracks, settings)
        self._track_of: dict[tuple[str, ...], Track | None] = {}
        self.strangers = 0
        names = (TIME, *start.columns)
        self._chosen = [names.index(name) for name in columns]

    def take(self, samples: Decoded) -> bool:
        """Adds messages' values. Returns True if they belong to one of the streams."""
        if samples.topic != self._topic:
            track = self._imu
        elif samples.columns in self._track_of:
            track = self._track_of[samples.columns]
        else:
            track = self._track_of[samples.columns] = self._joints.get(frozenset(samples.columns))
        if track is not None:
            track.take(samples)
        elif samples.topic == self._topic:
            self.strangers += len(samples.stamp)
        return track is not None

    def batch(self, *, final: bool = False) -> Array | None:
        """Rows completed since the last call, blank where a stream has no value; None if there are none. `final` if no
        more messages follow. Raises RecordingError: the stamps are not those of a clock.
        """
        stamps, values = self._alignment.rows(final=final)
        if not len(stamps):
            return None
        return np.vstack([stamps / 1e9, values.T])[self._chosen]

    def notes(self) -> Iterator[str]:
        """Yields notes on the whole log after its end, one sentence each."""
        if self.strangers:
            yield f"left out {self.strangers} messages of {self._topic} that are of other joints"
        reference, *others = self.tracks
        for track in self.tracks:
            if track.out_of_order:
                yield (
                    f"left out {track.out_of_order} of {track.seen} messages of {track.name} whose stamps repeat or "
                    "run back"
                )
        for track in self.tracks:
            yield from track.clock.notes(track.name)
        for track in others:
            if track.apart:
                yield (
                    f"the clock of {track.name} is up to {track.apart:+.3g} s behind that of {reference.name}: "
                    "corrected by the times of recording"
                )
            yield f"{track.name} ({track}) interpolated at the stamps of {reference.name} ({reference})"
        if self._imu is not None:
            offset = 1e3 * self._start.clock_offset
            yield f"clock of {self._imu.name} {offset:+.1f} ms off that of {reference.name}"
