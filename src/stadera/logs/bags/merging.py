"""Merges messages of joints and an IMU into rows at the joints' stamps, from a bag or a running robot."""

from collections.abc import Iterator, Sequence

import numpy as np

from stadera.logs.bags.alignment import Alignment, Track
from stadera.logs.bags.beginning import Beginning, joints_in
from stadera.logs.bags.container import Sample, SampleBatch
from stadera.logs.bags.settings import BagSettings
from stadera.logs.batches import Batch
from stadera.logs.columns import TIME


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

    def take(self, sample: Sample) -> bool:
        """Adds a message's values. Returns True if they belong to one of the streams."""
        track = self._imu if sample.topic != self._topic else self._of_joints(sample.columns)
        if track is not None:
            track.take(sample)
        return track is not None

    def take_many(self, samples: SampleBatch) -> None:
        """Adds several messages' values."""
        track = self._imu if samples.topic != self._topic else self._of_joints(samples.columns, len(samples.stamp))
        if track is not None:
            track.take_many(samples)

    def batch(self, *, final: bool = False) -> Batch | None:
        """Rows completed since the last call, blank where a stream has no value; None if there are none. `final` if no
        more messages follow. Raises RecordingError: the stamps are not those of a clock.
        """
        stamps, values = self._alignment.rows(final=final)
        if not len(stamps):
            return None
        cells = np.vstack([stamps / 1e9, values.T])[self._chosen]
        return Batch(cells, np.isnan(cells))

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

    def _of_joints(self, columns: tuple[str, ...], count: int = 1) -> Track | None:
        if columns not in self._track_of:
            self._track_of[columns] = self._joints.get(frozenset(columns))
        track = self._track_of[columns]
        self.strangers += count * (track is None)
        return track
