"""rosbag2 logs: the joints of one topic and an IMU, put together at the joints' stamps.

Stamps are those of the messages' headers. Streams that were not taken together are interpolated (`tracks`); samples at
which one of them says nothing are dropped and named, as blank cells of a table are.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain, islice
from pathlib import Path

import numpy as np
import pyarrow as pa

from stadera.errors import RecordingError
from stadera.recording.assemble import recordings
from stadera.recording.bag import Bag, Storage, bag_files, holds, missing_parts
from stadera.recording.bag_beginning import Beginning, beginning_of, first_events
from stadera.recording.bag_events import BagEvents, Event, chosen_topics
from stadera.recording.columns import IMU_COLUMNS, TIME, layout
from stadera.recording.publishers import Publisher
from stadera.recording.recording import Recording
from stadera.recording.ros_messages import JointState
from stadera.recording.topics import Topics
from stadera.recording.tracks import Alignment, Track

BATCH = 4096
"""Messages taken up at a time."""

_IMU_NAMES = tuple(name for names in IMU_COLUMNS.values() for name in names)
_QUATERNION = slice(6, 10)


@dataclass(frozen=True)
class BagLog:
    """Reads bags of one storage format: a file, or a folder of files.

    Attributes:
        name: what it reads, for messages.
        suffix: of the files.
        magic: how they begin.
        storage: how they are read.
    """

    name: str
    suffix: str
    magic: bytes
    storage: Storage

    @property
    def suffixes(self) -> tuple[str, ...]:
        """File name endings that promise this kind."""
        return (self.suffix,)

    def accepts(self, path: Path) -> bool:
        """A file that begins with the format's magic bytes, or a folder with files that are called so."""
        if not path.is_file():
            return holds(path, self.suffix)
        with path.open("rb") as file:
            return file.read(len(self.magic)) == self.magic

    def stream(
        self,
        path: Path,
        *,
        joints: Sequence[str] | None,
        require: Collection[str],
        rows: int | None,
        topics: Topics,
    ) -> Iterator[Recording]:
        """See `stadera.recording.stream`."""
        files = bag_files(path, self.suffix)
        bag = Bag(str(path), files, self.storage)
        joint_topic, imu_topic = chosen_topics(bag.topics(), topics, bag.source)
        if missing := missing_parts(files):
            bag.damage.append(missing)
        events = BagEvents(bag, joint_topic, imu_topic)
        head = first_events(events, imu=imu_topic is not None)
        if not any(isinstance(event.state, JointState) for event in head):
            why = "".join(f"; {damage}" for damage in bag.damage[:1])
            raise RecordingError(f"{path}: no message of topic {joint_topic} can be read{why}")
        start = beginning_of(head, f"{path}: {joint_topic}", joints, imu=imu_topic is not None)
        if start.imu_fault and "imu" in require:
            raise RecordingError(f"{path}: topic {imu_topic} cannot be used as IMU: {start.imu_fault}")
        names = (TIME, *(name for p in start.publishers for name in p.columns), *start.imu_columns)
        found = layout(names, str(path), joints, require)
        notes = (f"left out the IMU, topic {imu_topic}: {start.imu_fault}",) if start.imu_fault else ()
        found = replace(found, imu_frame=start.imu_frame, notes=(*notes, *found.notes))
        merging = _Merging(bag, start, events, joint_topic, imu_topic)
        return _with_last_words(recordings(merging.batches(found.columns), found, str(path), rows), merging)


class _Merging:
    """One pass over a bag's messages, put together row by row."""

    def __init__(self, bag: Bag, start: Beginning, events: BagEvents, joint_topic: str, imu_topic: str | None) -> None:
        self._bag, self._start, self._events, self._topic = bag, start, events, joint_topic
        several = len(start.publishers) > 1
        self._tracks = [
            Track(f"{joint_topic} ({p.joints[0]}, ...)" if several else joint_topic, len(p.columns))
            for p in start.publishers
        ]
        self._imu = Track(imu_topic, len(_IMU_NAMES), _QUATERNION) if imu_topic and start.imu_columns else None
        self._alignment = Alignment([*self._tracks, *([] if self._imu is None else [self._imu])])
        self._senders: dict[tuple[str, ...], tuple[Publisher, Track] | None] = {}
        self._strangers = 0

    def batches(self, columns: Collection[str]) -> Iterator[pa.RecordBatch]:
        """The rows as tables of these columns; blank where nothing is said. A table ends where a batch does."""
        events = chain(self._start.events, self._events)
        names = [name for p in self._start.publishers for name in p.columns]
        names += [] if self._imu is None else _IMU_NAMES
        more = True
        while more:
            batch = list(islice(events, BATCH))
            more = len(batch) == BATCH
            for event in batch:
                self._take(event)
            stamps, values = self._alignment.rows(final=not more)
            table = {TIME: pa.array(stamps / 1e9)}
            for name, column in zip(names, values.T, strict=True):
                if name in columns:
                    table[name] = pa.array(np.ascontiguousarray(column), mask=np.isnan(column))
            if len(stamps):
                yield pa.record_batch(table)

    def _take(self, event: Event) -> None:
        state = event.state
        if not isinstance(state, JointState):
            if self._imu is not None:
                self._imu.add(state.stamp, state.values)
            return
        if state.names not in self._senders:
            self._senders[state.names] = self._sender(frozenset(state.names))
        if (sender := self._senders[state.names]) is None:
            self._strangers += 1
        else:
            publisher, track = sender
            track.add(state.stamp, publisher.row(state))

    def _sender(self, names: frozenset[str]) -> tuple[Publisher, Track] | None:
        both = zip(self._start.publishers, self._tracks, strict=True)
        return next(((p, t) for p, t in both if frozenset(p.joints) == names), None)

    def notes(self) -> Iterator[str]:
        """What can be told of the whole at its end, one sentence each."""
        yield from self._bag.damage
        for topic, count in self._events.damaged.items():
            yield f"left out {count} damaged message{'s' * (count > 1)} of {topic}"
        if self._strangers:
            yield f"left out {self._strangers} messages of {self._topic} that are of other joints"
        reference = self._alignment.reference
        for track in (reference, *self._alignment.others):
            if track.out_of_order:
                yield (
                    f"left out {track.out_of_order} of {track.seen} messages of {track.name} whose stamps repeat or "
                    "run back"
                )
        for track in self._alignment.others:
            yield f"{track.name} ({_told(track)}) interpolated at the stamps of {reference.name} ({_told(reference)})"
        if self._imu is not None:
            yield f"clock of {self._imu.name} {1e3 * self._start.clock_offset:+.1f} ms off that of {reference.name}"


def _told(track: Track) -> str:
    gaps = f", {track.gaps} gap{'s' * (track.gaps > 1)}, the longest {1e-9 * track.longest:.3f} s" if track.gaps else ""
    return f"{track.rate_hz:.5g} Hz{gaps}"


def _with_last_words(chunks: Iterator[Recording], merging: _Merging) -> Iterator[Recording]:
    """The same chunks; the last one notes what can be told of the whole."""
    waiting = next(chunks, None)
    for chunk in chunks:
        if waiting is not None:
            yield waiting
        waiting = chunk
    if waiting is not None:
        yield replace(waiting, notes=(*waiting.notes, *merging.notes()))
