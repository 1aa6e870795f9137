"""Reads bags as logs: the joints of one topic and an IMU, merged at the joints' stamps.

Stamps are taken from the messages' headers. Streams with other stamps are interpolated (`alignment`). Samples at which
one of the streams has no value are dropped and reported, like blank cells of a table.
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Collection, Iterator, Sequence
from dataclasses import replace
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np

from stadera.boundary import begins_with, foreign
from stadera.errors import RecordingError
from stadera.limits import LimitError
from stadera.logs.bags.beginning import Beginning, beginning_of, first_samples
from stadera.logs.bags.choice import choose
from stadera.logs.bags.container import Bag, Bundle, Container, Message, Messages, Sample, SampleBatch
from stadera.logs.bags.decode import Decoder, decoder
from stadera.logs.bags.merging import Merging
from stadera.logs.bags.settings import DEFAULTS, BagSettings
from stadera.logs.bags.unitree import LowStates
from stadera.logs.batches import Batch, recordings, within
from stadera.logs.columns import TIME, layout
from stadera.logs.reading import Reading
from stadera.logs.recording import Recording
from stadera.logs.topics import LogFile
from stadera.logs.units import Units

_EARLIEST, _LATEST = -(1 << 61), 1 << 62
"""Range of a stamp [ns], up to the year 2116. Differences of such stamps do not overflow."""


class BagLog:
    """Reads bags of one format: a file, or a folder of files."""

    def __init__(self, container: Container, settings: BagSettings = DEFAULTS) -> None:
        self.container, self.settings = container, settings
        self.name, self.suffixes = container.name, (container.suffix,)

    def accepts(self, path: Path) -> bool:
        """True for a file that begins with the format's magic bytes, or a folder with files of its suffix."""
        suffix, magic = self.container.suffix, self.container.magic
        if path.is_dir():
            files = (p for p in path.iterdir() if p.is_file())
            return any(p.suffix == suffix or f"{suffix}.zst" in p.name for p in files)
        return begins_with(path, magic)

    def stream(
        self, log: LogFile, *, joints: Sequence[str] | None, require: Collection[str], rows: int | None
    ) -> Iterator[Recording]:
        """See `stadera.logs.stream`."""
        path = log.path
        if log.reading.columns is not None:
            raise RecordingError(f"{path}: a {self.name} has no columns: leave out --columns, which is for tables")
        bag = Bag.at(path, self.container, log.reading.limits)
        found = bag.topics()
        choice = choose(bag, found, log.topics, joints, self.settings)
        joint_topic, imu_topic = choice.joint, choice.imu
        chosen = [name for name in (joint_topic, imu_topic) if name is not None]
        with foreign(path, "definitions of messages"):
            decoders = {name: decoder(found[name], self.container.encoding, joints, self.settings) for name in chosen}
        samples = _Samples(bag, decoders)
        asked = None if joints is None else (*joints, *log.reading.others)
        start = self._beginning(samples, joint_topic, imu_topic, asked)
        if start.imu_fault and "imu" in require:
            raise RecordingError(f"{path}: topic {imu_topic} cannot be used as IMU: {start.imu_fault}")
        names = (TIME, *start.columns)
        table = layout(names, str(path), joints, require, stamped(log.reading))
        notes = (f"left out the IMU, topic {imu_topic}: {start.imu_fault}",) if start.imu_fault else ()
        table = replace(table, imu_frame=start.imu_frame, notes=(*choice.notes, *notes, *table.notes))
        merging = Merging(start, joint_topic, imu_topic, table.recorded, self.settings)
        batches = within(_batches(samples, start, merging, self.settings.batch), bag.budget, rows)
        notes_of_all = _notes(samples, merging, joint_topic)
        return _with_final_notes(recordings(batches, table, str(path), rows), notes_of_all)

    def _beginning(
        self, samples: _Samples, joint_topic: str, imu_topic: str | None, asked: Sequence[str] | None
    ) -> Beginning:
        path = samples.bag.path
        head = first_samples(samples, joint_topic, imu_topic, self.settings)
        if not any(sample.topic == joint_topic for sample in head):
            why = "".join(f"; {damage}" for damage in samples.bag.damage[:1])
            raise RecordingError(f"{path}: no message of topic {joint_topic} can be read{why}")
        try:
            return beginning_of(head, joint_topic, imu_topic, asked)
        except RecordingError as error:
            raise RecordingError(f"{path}: {error}") from None


def stamped(reading: Reading) -> Reading:
    """The reading without a unit of time: stamps of messages are in seconds and nanoseconds."""
    units = {quantity: unit for quantity, unit in reading.units.of.items() if quantity != TIME}
    return replace(reading, units=Units(units))


class _Samples:
    """Values of a bag's messages; damaged messages are counted by topic. Iterated one by one, in the order of recording
    except between topics of a bundle, or several at once.
    """

    def __init__(self, bag: Bag, decoders: dict[str, Decoder]) -> None:
        self.bag, self.decoders = bag, decoders
        self.damaged: Counter[str] = Counter()
        self._messages = bag.messages(decoders)
        self._ahead: deque[Message] = deque()  # of a bundle that was begun

    def __iter__(self) -> Iterator[Sample]:
        while (message := self._next()) is not None:
            if (sample := self._decoded(message)) is not None:
                yield sample

    def several(self) -> Iterator[list[Sample | SampleBatch]]:
        """Yields the values of a message, or of all messages of a bundle."""
        while self._ahead:
            sample = self._decoded(self._ahead.popleft())
            yield [] if sample is None else [sample]
        for item in self._messages:
            if isinstance(item, Bundle):
                yield [samples for group in item.groups for samples in self._of(group)]
            else:
                sample = self._decoded(item)
                yield [] if sample is None else [sample]

    def _next(self) -> Message | None:
        while not self._ahead:
            item = next(self._messages, None)
            if not isinstance(item, Bundle):
                return item
            self._ahead.extend(item.each())
        return self._ahead.popleft()

    def _of(self, group: Messages) -> Iterator[Sample | SampleBatch]:
        try:
            samples = self.decoders[group.topic].many(group)
        except (IndexError, ValueError):  # shorter than the layout
            samples = None
        if samples is None:
            found = (self._decoded(message) for message in group.each())
            yield from (sample for sample in found if sample is not None)
            return
        self.bag.budget.require_columns(samples.columns)
        good = _is_time(samples.stamp) & _is_time(samples.received)
        if not good.all():
            self.damaged[group.topic] += int(np.count_nonzero(~good))
            samples = samples._replace(**{n: getattr(samples, n)[good] for n in ("stamp", "received", "values")})
        yield samples

    def _decoded(self, message: Message) -> Sample | None:
        try:
            sample = self.decoders[message.topic](message)
            self.bag.budget.require_columns(sample.columns)
        except LimitError:
            raise
        except Exception:  # the libraries raise many kinds of errors on damaged bytes
            self.damaged[message.topic] += 1
            return None
        if _is_time(sample.stamp) and _is_time(sample.received):
            return sample
        self.damaged[message.topic] += 1
        return None


def _is_time(stamp: Any) -> Any:
    """Whether a stamp, or each of several, is within the range of stamps."""
    return (stamp >= _EARLIEST) & (stamp < _LATEST)


def _batches(samples: _Samples, start: Beginning, merging: Merging, batch: int) -> Iterator[Batch]:
    """The rows of all messages."""
    count = 0
    head: list[Sample | SampleBatch] = list(start.samples)
    for some in chain([head], samples.several()):
        for found in some:
            if isinstance(found, SampleBatch):
                merging.take_many(found)
                count += len(found.stamp)
            else:
                merging.take(found)
                count += 1
        if count >= batch:
            count = 0
            if (rows := merging.batch()) is not None:
                yield rows
    if (rows := merging.batch(final=True)) is not None:
        yield rows


def _notes(samples: _Samples, merging: Merging, topic: str) -> Iterator[str]:
    """Yields notes on the whole log after its end, one sentence each."""
    yield from samples.bag.damage
    for name, count in samples.damaged.items():
        yield f"left out {count} damaged message{'s' * (count > 1)} of {name}"
    yield from merging.notes()
    if isinstance(states := samples.decoders[topic], LowStates):
        yield from states.notes(topic)


def _with_final_notes(chunks: Iterator[Recording], notes: Iterator[str]) -> Iterator[Recording]:
    """Yields the same chunks; the last one includes the notes on the whole log."""
    waiting = next(chunks, None)
    for chunk in chunks:
        if waiting is not None:
            yield waiting
        waiting = chunk
    if waiting is not None:
        yield replace(waiting, notes=(*waiting.notes, *notes))
