"""Merges messages of joints and an IMU into rows at the joints' stamps, from a bag or a running robot.

The first messages determine which publisher provides which columns.
"""

from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from stadera.errors import RecordingError
from stadera.logs.bags.alignment import Alignment, Track
from stadera.logs.bags.choice import Choice
from stadera.logs.bags.container import BagSettings, Decoded
from stadera.logs.bags.decode import IMU_NAMES, Columns, joints_in
from stadera.logs.columns import TIME, Layout, layout
from stadera.logs.topics import ReadOptions
from stadera.types import Array


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


def _publishers(
    samples: Sequence[Decoded], joints: Sequence[str] | None, *, imu: bool
) -> dict[frozenset[str], Columns]:
    """Publishers of one topic, the one with most of the requested joints first.

    Publishers of none of these joints are skipped, unless all are; so are samples without columns. With `imu`, columns
    of an IMU in the same messages are kept.
    """
    groups: dict[frozenset[str], list[Decoded]] = {}
    for sample in samples:
        if sample.columns:
            groups.setdefault(frozenset(sample.columns), []).append(sample)
    if not groups:
        raise RecordingError(f"{samples[0].topic}: its messages name no joints")
    named = {key: joints_in(group[0].columns) for key, group in groups.items()}
    asked = frozenset(joints or ()) & frozenset().union(*named.values())
    shared = {key: len(asked.intersection(named[key]) if asked else key) for key in groups}
    kept = sorted(filter(shared.get, groups), key=lambda key: -shared[key])
    _check_agreement([named[key] for key in groups if key in kept], samples[0].topic)
    left_out = () if imu else IMU_NAMES
    return {key: tuple(name for name in _known(groups[key]) if name not in left_out) for key in kept}


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
    """Merges one pass of messages into rows of the flat table, by the layout of the first ones, `head`, for the joints
    requested; None for all. RecordingError: the publishers contradict each other.

    Attributes:
        columns: of all publishers, named as in the flat table.
        imu_frame: frame_id of the IMU's messages, None if empty.
        imu_fault: why an existing IMU cannot be used; empty if it can.
        tracks: the streams; the first one's stamps are used.
        strangers: number of messages of the joints' topic that name other joints, which are skipped.
    """

    def __init__(
        self, head: Sequence[Decoded], choice: Choice, joints: Sequence[str] | None, settings: BagSettings
    ) -> None:
        self._topic = topic = choice.joint
        of_joints = [sample for sample in head if sample.topic == topic]
        of_imu = [sample for sample in head if sample.topic == choice.imu]
        self._offset = _delay(of_joints) - _delay(of_imu)  # of the IMU's clock from the joints', by recording [s]
        self.imu_fault = _fault(of_imu) if choice.imu is not None else ""
        publishers = _publishers(of_joints, joints, imu=choice.imu is None)
        self._joints = {
            key: Track(f"{topic} ({joints_in(columns)[0]}, ...)" if len(publishers) > 1 else topic, columns, settings)
            for key, columns in publishers.items()
        }
        usable = choice.imu is not None and not self.imu_fault
        self._imu = Track(str(choice.imu), _known(of_imu), settings) if usable else None
        self.imu_frame = (of_imu[0].frame or None) if usable else None
        self.tracks = (*self._joints.values(), *([] if self._imu is None else [self._imu]))
        self.columns = (TIME, *(name for track in self.tracks for name in track.columns))
        self._alignment = Alignment(self.tracks, settings)
        self._track_of: dict[tuple[str, ...], Track | None] = {}
        self.strangers = 0
        self._chosen = list(range(len(self.columns)))

    def layout(
        self, source: str, joints: Sequence[str] | None, require: Collection[str], reading: ReadOptions
    ) -> Layout:
        """The layout of the columns, as `stadera.logs.columns.layout`; rows are those of its columns from now on."""
        found = layout(self.columns, source, joints, require, reading)
        self._chosen = [self.columns.index(name) for name in found.recorded]
        return replace(found, imu_frame=self.imu_frame)

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
            yield f"clock of {self._imu.name} {1e3 * self._offset:+.1f} ms off that of {reference.name}"
