"""Reads bags as logs: the joints of one topic and an IMU, merged at the joints' stamps.

Stamps are taken from the messages' headers. Streams with other stamps are interpolated (`alignment`). Samples at which
one of the streams has no value are dropped and reported, like blank cells of a table.
"""

from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import chain, islice
from pathlib import Path

import numpy as np

from stadera.boundary import begins_with, foreign
from stadera.errors import ClosedLoopError, RecordingError
from stadera.limits import LimitError
from stadera.logs.bags.choice import Offer, choose
from stadera.logs.bags.container import EARLIEST, LATEST, Bag, BagSettings, Decoded, Message, Stamps
from stadera.logs.bags.decode import Decoder, decoder
from stadera.logs.bags.files import Container
from stadera.logs.bags.merging import Merging, first_samples
from stadera.logs.bags.unitree import LowStates
from stadera.logs.batches import recordings, within
from stadera.logs.recording import Recording
from stadera.logs.topics import LogFile
from stadera.types import Array, Bools


class BagLog:
    """Reads bags of one format: a file, or a folder of files."""

    def __init__(self, container: Container, settings: BagSettings | None = None) -> None:
        self.container, self.settings = container, settings or BagSettings()
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
        log.reading.refuse_time(str(path))
        bag = Bag.at(path, self.container, log.reading.limits)
        found = bag.topics()
        probe = replace(bag, damage=[])  # damage is reported when the bag is read
        offer = Offer(str(path), self.container.encoding, found, probe.messages)
        choice = choose(offer, log.topics, joints, self.settings)
        chosen = [name for name in (choice.joint, choice.imu) if name is not None]
        with foreign(path, "definitions of messages"):
            decoders = {name: decoder(found[name], self.container.encoding, joints, self.settings) for name in chosen}
        damaged: Counter[str] = Counter()
        samples = _samples(bag, decoders, damaged, self.settings)
        head = first_samples(samples, choice.joint, choice.imu, self.settings)
        if not any(one.topic == choice.joint for one in head):
            why = "".join(f"; {damage}" for damage in bag.damage[:1])
            raise RecordingError(f"{path}: no message of topic {choice.joint} can be read{why}")
        asked = None if joints is None else (*joints, *log.reading.others)
        try:
            merging = Merging(head, choice, asked, self.settings)
        except RecordingError as error:
            raise RecordingError(f"{path}: {error}") from None
        if merging.imu_fault and "imu" in require:
            raise RecordingError(f"{path}: topic {choice.imu} cannot be used as IMU: {merging.imu_fault}")
        table = merging.layout(str(path), joints, require, log.reading)
        notes = (f"left out the IMU, topic {choice.imu}: {merging.imu_fault}",) if merging.imu_fault else ()
        table = replace(table, notes=(*choice.notes, *notes, *table.notes))
        batches = within(_batches(chain(head, samples), merging, self.settings.batch), bag.budget, rows)
        notes_of_all = _notes(bag, damaged, merging, choice.joint, decoders[choice.joint])
        return _with_final_notes(recordings(batches, table, str(path), rows), notes_of_all)


def _samples(
    bag: Bag, decoders: Mapping[str, Decoder], damaged: Counter[str], settings: BagSettings
) -> Iterator[Decoded]:
    """Values of a bag's messages, in the order of recording except between topics; `damaged` ones by topic."""
    messages = bag.messages(decoders)
    while some := list(islice(messages, settings.decoded)):
        by_topic: dict[str, list[Message]] = {}
        for message in some:
            by_topic.setdefault(message.topic, []).append(message)
        for topic, group in by_topic.items():
            for samples in _decoded(group, decoders[topic], damaged):
                bag.budget.require_columns(samples.columns)
                good = _is_time(samples.stamp) & _is_time(samples.received)
                if not good.all():
                    damaged[topic] += int(np.count_nonzero(~good))
                    samples = samples._replace(
                        **{n: getattr(samples, n)[good] for n in ("stamp", "received", "values")}
                    )
                if len(samples.stamp):
                    yield samples


def _decoded(messages: Sequence[Message], decode: Decoder, damaged: Counter[str]) -> Iterator[Decoded]:
    """Values of messages of one topic: one by one if they cannot all be decoded."""
    try:
        yield from decode(messages)
    except (LimitError, ClosedLoopError):
        raise
    except Exception:  # the libraries raise many kinds of errors on damaged bytes
        if len(messages) == 1:
            damaged[messages[0].topic] += 1
            return
        for message in messages:
            yield from _decoded([message], decode, damaged)


def _is_time(stamps: Stamps) -> Bools:
    return np.asarray((stamps >= EARLIEST) & (stamps < LATEST))


def _batches(found: Iterable[Decoded], merging: Merging, batch: int) -> Iterator[Array]:
    """The rows of all messages."""
    count = 0
    for samples in found:
        merging.take(samples)
        count += len(samples.stamp)
        if count >= batch:
            count = 0
            if (rows := merging.batch()) is not None:
                yield rows
    if (rows := merging.batch(final=True)) is not None:
        yield rows


def _notes(bag: Bag, damaged: Counter[str], merging: Merging, topic: str, states: Decoder) -> Iterator[str]:
    """Yields notes on the whole log after its end, one sentence each."""
    yield from bag.damage
    for name, count in damaged.items():
        yield f"left out {count} damaged message{'s' * (count > 1)} of {name}"
    yield from merging.notes()
    if isinstance(states, LowStates):
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
