"""Reads logs for identification: in several passes, in parts, preprocessed, with memory independent of their length."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from zlib import crc32

import numpy as np

from stadera.errors import RecordingError
from stadera.logs.processing import Preprocessing, Processed, preprocess_stream
from stadera.logs.reader import stream
from stadera.logs.recording import Recording, take
from stadera.logs.topics import LogFile


def without_spikes(recording: Recording, usual: float = 0.99, wild: float = 3.0) -> Recording:
    """Replaces each outlier in the joint signals by the median of itself and its neighbours, and notes their number.

    An outlier is further from that median than its signal ever changes between two samples: than `wild` times the
    quantile `usual` of its steps. Of white Gaussian noise 3 are eleven standard deviations. A step equals its own
    median, so it is not an outlier.
    """
    changed, count = {}, 0
    for channel in ("position", "velocity", "effort"):
        values = getattr(recording, channel)
        if values is None or len(recording) < 3:
            continue
        median = values.copy()
        median[1:-1] = np.median([values[:-2], values[1:-1], values[2:]], axis=0)
        step = np.quantile(np.abs(np.diff(values, axis=0)), usual, axis=0)
        outlier = np.abs(values - median) > wild * step
        if outlier.any():
            changed[channel], count = np.where(outlier, median, values), count + int(outlier.sum())
    if not count:
        return recording
    note = f"replaced {count} wild value{'s' * (count > 1)} of {', '.join(changed)}"
    return replace(recording, **changed, notes=(*recording.notes, note))


Log = Recording | LogFile
"""A recording in memory, or a file that is streamed again in each pass."""

KEEP_SAMPLES = 500_000
"""Largest number of processed samples of a part that are kept in memory between passes."""


def chunks(log: Log, joints: Sequence[str]) -> Iterator[Recording]:
    """The log's samples in order, with positions and efforts of these joints, outliers replaced."""
    return (without_spikes(chunk) for chunk in stream(log, joints=joints, require=("effort",)))


def head(log: Log, joints: Sequence[str]) -> Recording:
    """The log's first chunk; RecordingError for an empty log."""
    for chunk in chunks(log, joints):
        return chunk
    raise RecordingError(f"{log.source}: too few samples: none")


def has_effort(log: Log, joints: Sequence[str]) -> bool:
    """True if these joints are recorded with their efforts."""
    try:
        return next(stream(log, joints=joints, require=("effort",), rows=2), None) is not None
    except RecordingError:
        return False


def require_distinct(logs: Sequence[Log], joints: Sequence[str]) -> None:
    """Raises RecordingError if a log is given twice: its samples would count twice, or validate themselves."""
    seen: dict[int, str] = {}
    for log in logs:
        beginning = head(log, joints)
        samples = np.hstack([beginning.position, beginning.channel("effort", tuple(joints))])
        checksum = crc32(samples.astype(np.float32).tobytes())  # files of another format may have single precision
        if (other := seen.get(checksum)) is not None:
            again = "given twice" if other == log.source else f"holds the same samples as {other}"
            raise RecordingError(f"{log.source}: {again}; give each log once")
        seen[checksum] = log.source


def time_span(log: Log, joints: Sequence[str]) -> tuple[float, float]:
    """First and last stamp [s]."""
    first, last = np.inf, -np.inf
    for chunk in chunks(log, joints):
        first, last = min(first, float(chunk.time[0])), float(chunk.time[-1])
    return first, last


@dataclass(frozen=True, eq=False)
class Section:
    """The part of a log between two times [s], `start` included, `stop` excluded; outliers replaced."""

    log: Log
    start: float = -np.inf
    stop: float = np.inf

    def recordings(self, joints: Sequence[str]) -> Iterator[Recording]:
        """Yields its samples, chunk by chunk."""
        for chunk in chunks(self.log, joints):
            first, last = np.searchsorted(chunk.time, (self.start, self.stop))
            if first < last:
                yield chunk if last - first == len(chunk) else take(chunk, slice(int(first), int(last)))
            if last < len(chunk):
                return


class Part:
    """Stretches of logs (the training or validation part), preprocessed in the same way, for several passes.

    Stretches of up to `KEEP_SAMPLES` samples are kept in memory after the first pass; longer ones are read again.
    """

    def __init__(self, stretches: Sequence[Section], joints: Sequence[str], settings: Preprocessing) -> None:
        self.stretches, self.joints, self.settings = tuple(stretches), tuple(joints), settings
        self._kept: dict[Section, tuple[Processed, ...]] = {}
        self._notes: dict[Section, tuple[str, ...]] = {}

    def of(self, stretches: Sequence[Section], *others: Part) -> Part:
        """Some stretches of this part and of others, with what these have in memory."""
        part = Part(stretches, self.joints, self.settings)
        part._kept = dict(chain.from_iterable(p._kept.items() for p in (self, *others)))
        return part

    @property
    def notes(self) -> tuple[str, ...]:
        """Remarks on the processing, available after a pass."""
        return tuple(dict.fromkeys(note for notes in self._notes.values() for note in notes))

    def moves(self, slowest: float) -> bool:
        """True if any joint is ever at least this fast [rad/s]."""
        return any(bool((np.abs(chunk.velocity) >= slowest).any()) for chunk in self)

    def still(self, travel: float) -> frozenset[str]:
        """Joints that stay within this travel [rad]."""
        low, high = np.full(len(self.joints), np.inf), np.full(len(self.joints), -np.inf)
        for chunk in self:
            low = np.minimum(low, chunk.position.min(axis=0, initial=np.inf))
            high = np.maximum(high, chunk.position.max(axis=0, initial=-np.inf))
        return frozenset(joint for joint, way in zip(self.joints, high - low, strict=True) if way < travel)

    def __iter__(self) -> Iterator[Processed]:
        """Yields all chunks of all stretches."""
        return chain.from_iterable(self.streams())

    def streams(self) -> Iterator[Iterator[Processed]]:
        """Yields the chunks of each stretch."""
        return (self._stream(stretch) for stretch in self.stretches)

    def _stream(self, stretch: Section) -> Iterator[Processed]:
        if stretch in self._kept:
            yield from self._kept[stretch]
            return
        kept: list[Processed] | None = []
        samples = 0
        notes: dict[str, None] = {}
        for chunk in preprocess_stream(stretch.recordings(self.joints), self.settings, self.joints):
            if not len(chunk) and not chunk.notes:
                continue
            samples += len(chunk)
            notes |= dict.fromkeys(chunk.notes)
            if kept is not None:
                kept = [*kept, chunk] if samples <= KEEP_SAMPLES else None
            yield chunk
        self._notes[stretch] = tuple(notes)
        if kept is not None:
            self._kept[stretch] = tuple(kept)
