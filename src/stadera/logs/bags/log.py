"""Bags as logs: the joints of one topic and an IMU, put together at the joints' stamps.

Stamps are those of the messages' headers. Streams with stamps of their own are interpolated (`alignment`). Samples at
which one of them has no value are dropped and reported, as blank cells of a table are.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain, islice
from pathlib import Path

import numpy as np

from stadera.errors import RecordingError
from stadera.logs.bags.alignment import Alignment, Track
from stadera.logs.bags.beginning import Beginning, beginning_of, chosen_topics, first_samples, joints_in
from stadera.logs.bags.container import Bag, Container
from stadera.logs.bags.decode import Decoder, Sample, decoder
from stadera.logs.bags.settings import DEFAULTS, BagSettings
from stadera.logs.bags.unitree import LowStates
from stadera.logs.batches import Batch, recordings
from stadera.logs.columns import TIME, layout
from stadera.logs.recording import Recording
from stadera.logs.topics import Topics


@dataclass(frozen=True)
class BagLog:
    """Reads bags of one format: a file, or a folder of files."""

    container: Container
    settings: BagSettings = DEFAULTS

    @property
    def name(self) -> str:
        """What it reads, for messages."""
        return self.container.name

    @property
    def suffixes(self) -> tuple[str, ...]:
        """File name endings that promise this kind."""
        return (self.container.suffix,)

    def accepts(self, path: Path) -> bool:
        """A file that begins with the format's magic bytes, or a folder with files that are called so."""
        suffix, magic = self.container.suffix, self.container.magic
        if path.is_dir():
            return any(p.suffix == suffix or f"{suffix}.zst" in p.name for p in path.iterdir())
        with path.open("rb") as file:
            return file.read(len(magic)) == magic

    def stream(
        self, path: Path, *, joints: Sequence[str] | None, require: Collection[str], rows: int | None, topics: Topics
    ) -> Iterator[Recording]:
        """See `stadera.logs.stream`."""
        bag = Bag.at(path, self.container)
        found = bag.topics()
        joint_topic, imu_topic = chosen_topics(found, topics, str(path))
        chosen = [name for name in (joint_topic, imu_topic) if name is not None]
        decoders = {name: decoder(found[name], self.container.encoding, joints, self.settings) for name in chosen}
        samples = _Samples(bag, decoders)
        head = first_samples(samples, joint_topic, imu_topic, self.settings)
        if not any(sample.topic == joint_topic for sample in head):
            why = "".join(f"; {damage}" for damage in bag.damage[:1])
            raise RecordingError(f"{path}: no message of topic {joint_topic} can be read{why}")
        try:
            start = beginning_of(head, joint_topic, imu_topic, joints, self.settings)
        except RecordingError as error:
            raise RecordingError(f"{path}: {error}") from None
        if start.imu_fault and "imu" in require:
            raise RecordingError(f"{path}: topic {imu_topic} cannot be used as IMU: {start.imu_fault}")
        names = (TIME, *start.columns)
        table = layout(names, str(path), joints, require)
        notes = (f"left out the IMU, topic {imu_topic}: {start.imu_fault}",) if start.imu_fault else ()
        table = replace(table, imu_frame=start.imu_frame, notes=(*notes, *table.notes))
        merging = _Merging(samples, start, joint_topic, imu_topic, self.settings)
        return _with_final_notes(recordings(merging.batches(names, table.columns), table, str(path), rows), merging)


class _Samples:
    """The values of a bag's messages, in the order of recording; damaged messages are counted.

    Attributes:
        damaged: by topic, messages that could not be read.
    """

    def __init__(self, bag: Bag, decoders: dict[str, Decoder]) -> None:
        self.bag, self.decoders = bag, decoders
        self.damaged: Counter[str] = Counter()
        self._messages = bag.messages(decoders)

    def __iter__(self) -> Iterator[Sample]:
        for message in self._messages:
            try:
                sample = self.decoders[message.topic](message)
            except Exception:  # the libraries meet damaged bytes with errors of many kinds
                self.damaged[message.topic] += 1
            else:
                yield sample


class _Merging:
    """One pass over a bag's messages, put together row by row."""

    def __init__(
        self, samples: _Samples, start: Beginning, topic: str, imu_topic: str | None, settings: BagSettings
    ) -> None:
        self._samples, self._start, self._topic, self._batch = samples, start, topic, settings.batch
        several = len(start.joints) > 1
        self._joints = {
            key: Track(f"{topic} ({joints_in(columns)[0]}, ...)" if several else topic, columns, settings)
            for key, columns in start.joints.items()
        }
        self._imu = Track(imu_topic, start.imu, settings) if imu_topic is not None and start.imu is not None else None
        tracks = [*self._joints.values(), *([] if self._imu is None else [self._imu])]
        self._alignment = Alignment(tracks, settings)
        self._track_of: dict[tuple[str, ...], Track | None] = {}
        self._strangers = 0

    def batches(self, names: Sequence[str], columns: Sequence[str]) -> Iterator[Batch]:
        """The rows, of all streams' names the chosen columns; blank where a stream has no value."""
        samples, chosen = chain(self._start.samples, self._samples), [names.index(name) for name in columns]
        more = True
        while more:
            some = list(islice(samples, self._batch))
            more = len(some) == self._batch
            for sample in some:
                self._take(sample)
            stamps, values = self._alignment.rows(final=not more)
            if len(stamps):
                cells = np.vstack([stamps / 1e9, values.T])[chosen]
                yield Batch(cells, np.isnan(cells))

    def _take(self, sample: Sample) -> None:
        if sample.topic != self._topic:
            track = self._imu
        else:
            if sample.columns not in self._track_of:
                self._track_of[sample.columns] = self._joints.get(frozenset(sample.columns))
            track = self._track_of[sample.columns]
            self._strangers += track is None
        if track is not None:
            track.take(sample)

    def notes(self) -> Iterator[str]:
        """What is known of the whole at its end, one sentence each."""
        yield from self._samples.bag.damage
        for topic, count in self._samples.damaged.items():
            yield f"left out {count} damaged message{'s' * (count > 1)} of {topic}"
        if self._strangers:
            yield f"left out {self._strangers} messages of {self._topic} that are of other joints"
        reference, others = self._alignment.reference, self._alignment.others
        for track in (reference, *others):
            if track.out_of_order:
                yield (
                    f"left out {track.out_of_order} of {track.seen} messages of {track.name} whose stamps repeat or "
                    "run back"
                )
        for track in others:
            yield f"{track.name} ({track}) interpolated at the stamps of {reference.name} ({reference})"
        if self._imu is not None:
            offset = 1e3 * self._start.clock_offset
            yield f"clock of {self._imu.name} {offset:+.1f} ms off that of {reference.name}"
        if isinstance(states := self._samples.decoders[self._topic], LowStates):
            yield from states.notes(self._topic)


def _with_final_notes(chunks: Iterator[Recording], merging: _Merging) -> Iterator[Recording]:
    """The same chunks; the last one notes what is known of the whole."""
    waiting = next(chunks, None)
    for chunk in chunks:
        if waiting is not None:
            yield waiting
        waiting = chunk
    if waiting is not None:
        yield replace(waiting, notes=(*waiting.notes, *merging.notes()))
