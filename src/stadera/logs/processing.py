"""Prepares a log for regressors: even sampling, filtering, differentiation.

After section IV.B of Tournois et al. (IROS 2017): all variables go through one zero-delay low-pass filter. Reading in
chunks gives the same result as reading the whole log.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from typing import Any

import numpy as np

from stadera.errors import RecordingError
from stadera.logs.filters import apply, kernels
from stadera.logs.recording import Recording, concatenate
from stadera.logs.sampling import HEAD, Block, resampled, sampling_of, segments, windows
from stadera.types import Array

LONGEST_DELAY = 0.2
"""Longest plausible delay [s]; a larger one indicates another recording's clock."""


@dataclass(frozen=True)
class Preprocessing:
    """Settings for preparing a log for regressors. Raises RecordingError: a setting is out of its range."""

    # -3 dB frequency of the low-pass filter [Hz]. None for no filter: recorded velocities and accelerations are used
    # unchanged, and missing ones are computed by central differences.
    cutoff_hz: float | None
    # delay of the effort at the joint relative to its stamp [s]: positive for commands that reach the motor late,
    # negative for sensors that report late
    effort_delay: float = 0.0

    def __post_init__(self) -> None:
        """Validates the settings."""
        if self.cutoff_hz is not None and not (np.isfinite(self.cutoff_hz) and self.cutoff_hz > 0):
            raise RecordingError(f"cut-off needs to be above 0 Hz, got {self.cutoff_hz:g}")
        if not abs(self.effort_delay) <= LONGEST_DELAY:
            raise RecordingError(
                f"effort_delay needs to be within {LONGEST_DELAY:g} s either way, got {self.effort_delay:g}"
            )


@dataclass(frozen=True)
class PreprocessingReport:
    """Report on the preprocessing of a log, up to and including the chunk that carries it."""

    rate_hz: float  # of the result [Hz]
    cutoff_hz: float | None  # -3 dB [Hz], None where not filtered
    resampled: bool  # True if values were interpolated to an even grid
    window: int  # samples that the filter and the differences need for each output sample
    effort_delay: float = 0.0  # by which the effort was shifted [s]
    samples_in: int = 0  # samples read
    segments: int = 0  # stretches without a gap
    short_segments: int = 0  # segments shorter than the filter's window, which were dropped
    samples_out: int = 0  # samples of the result

    @property
    def notes(self) -> tuple[str, ...]:
        """The report in sentences, with units."""
        notes = [
            f"low-pass filtered all signals without delay, -3 dB at {self.cutoff_hz:.4g} Hz"
            if self.cutoff_hz is not None
            else "not filtered"
        ]
        if self.resampled:
            notes.insert(0, f"resampled uneven time stamps to {self.rate_hz:.6g} Hz")
        if self.effort_delay:
            notes.append(f"moved the effort by {1e3 * self.effort_delay:+.4g} ms")
        if self.segments > 1:
            notes.append(f"split at {self.segments - 1} gap{'s' * (self.segments > 2)} into {self.segments} segments")
        if self.short_segments:
            notes.append(
                f"dropped {self.short_segments} segment{'s' * (self.short_segments > 1)} shorter than the "
                f"{self.window / self.rate_hz:.3g} s that the filter needs"
            )
        if self.window > 1:
            edge = self.window // 2
            notes.append(f"trimmed {edge} samples ({edge / self.rate_hz:.3g} s) at both ends of every segment")
        notes.append(f"{self.samples_out} of {self.samples_in} samples at {self.rate_hz:.6g} Hz are left")
        return tuple(notes)


@dataclass(frozen=True, eq=False)
class Processed:
    """Signals of the selected joints, all through the same filter, with notes of the log and of the report, whose last
    chunk covers the whole log.
    """

    time: Array  # (samples,) [s]; even except at gaps
    joints: tuple[str, ...]
    # position, velocity, acceleration: (samples, n) [rad, rad/s, rad/s²]
    position: Array
    velocity: Array
    acceleration: Array
    effort: Array | None  # (samples, n) [N·m], None where not recorded
    report: PreprocessingReport
    source: str = "recording"
    notes: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.time)


def preprocess(recording: Recording, settings: Preprocessing, joints: Sequence[str] | None = None) -> Processed:
    """Preprocesses a whole recording; keeps these joints, in this order (None: all). RecordingError if there are too
    few samples for the filter, or its cut-off is too high for the rate; UnknownNameError for a joint that is not
    recorded.
    """
    parts = tuple(preprocess_stream([recording], settings, joints))
    last = parts[-1]
    signals = ["time", "position", "velocity", "acceleration", *([] if last.effort is None else ["effort"])]
    joined: dict[str, Any] = {name: np.concatenate([getattr(part, name) for part in parts]) for name in signals}
    return replace(last, **joined) if len(parts) > 1 else last


def preprocess_stream(
    chunks: Iterable[Recording], settings: Preprocessing, joints: Sequence[str] | None = None
) -> Iterator[Processed]:
    """Preprocesses consecutive chunks of one log, with the results and errors of `preprocess` of the whole log.

    Memory does not grow with the log's length. The rate, and whether stamps are uneven, are determined from the first
    4096 samples.
    """
    chunks, parts = iter(chunks), list[Recording]()
    while sum(map(len, parts)) < HEAD and (chunk := next(chunks, None)) is not None:
        parts.append(chunk)
    if not parts:
        raise RecordingError("too few samples: none")
    head = concatenate(parts)
    return _Pass(head, settings, tuple(joints) if joints is not None else head.joints).over(chain([head], chunks))


class _Pass:
    """One pass over a log, prepared by its beginning: `channels` are stacked, each with a row for every joint."""

    def __init__(self, head: Recording, settings: Preprocessing, joints: tuple[str, ...]) -> None:
        self.settings, self.joints, self.source = settings, joints, head.source
        self.channels = ["position"]
        if settings.cutoff_hz is None:
            self.channels += [name for name in ("velocity", "acceleration") if getattr(head, name) is not None]
        if head.effort is not None:
            self.channels.append("effort")
        self.sampling = sampling_of(head.time, head.source)
        derivatives = not {"velocity", "acceleration"} <= set(self.channels)
        rate_hz, delay = self.sampling.rate_hz, settings.effort_delay
        self.window = kernels(rate_hz, settings.cutoff_hz, derivatives=derivatives, delay=delay)
        self.notes: dict[str, None] = {}
        self.report = PreprocessingReport(
            rate_hz, settings.cutoff_hz, not self.sampling.even, 2 * self.window.half + 1, delay
        )

    def over(self, chunks: Iterable[Recording]) -> Iterator[Processed]:
        """Yields the results of consecutive chunks; the last one has the report on the whole log."""
        blocks = segments(self._stacks(chunks), self.sampling)
        if not self.sampling.even:
            blocks = resampled(blocks, self.sampling.period)
        pending: Processed | None = None
        for block in windows(self._counted(blocks), self.window.half):
            if pending is not None:
                yield pending
            pending = self._differentiated(block)
        if pending is None:
            window, found = self.report.window, self.report.segments
            raise RecordingError(
                f"{self.source}: too few samples: {self.report.samples_in} in {found} stretch{'es' * (found != 1)} "
                f"without a gap, none as long as the {window} samples ({window * self.sampling.period:.3g} s) that the "
                "filter needs"
            )
        yield replace(pending, report=self.report, notes=(*self.notes, *self.report.notes))

    def _count(self, **counts: int) -> None:
        self.report = replace(self.report, **{name: getattr(self.report, name) + n for name, n in counts.items()})

    def _stacks(self, chunks: Iterable[Recording]) -> Iterator[tuple[Array, Array]]:
        for chunk in chunks:
            self.source = chunk.source
            self._count(samples_in=len(chunk))
            self.notes |= dict.fromkeys(chunk.notes)
            yield chunk.time, np.concatenate([chunk.channel(name, self.joints).T for name in self.channels])

    def _counted(self, blocks: Iterable[Block]) -> Iterator[Block]:
        """Yields the same blocks; counts segments, and those shorter than a window."""
        samples = 0
        for block in blocks:
            samples = len(block.time) + (0 if block.start else samples)
            self._count(segments=block.start, short_segments=block.end and samples < self.report.window)
            yield block

    def _differentiated(self, block: Block) -> Processed:
        """Every channel filtered; velocity and acceleration by the derivative kernels if they are not recorded."""
        window = self.window
        raw = dict(zip(self.channels, np.split(block.values, len(self.channels)), strict=True))
        out = {name: apply(window.late if name == "effort" else window.value, rows) for name, rows in raw.items()}
        if "velocity" not in raw:
            out["velocity"] = apply(window.first, raw["position"])
        if "acceleration" not in raw:
            kernel, source = (window.first, "velocity") if "velocity" in raw else (window.second, "position")
            out["acceleration"] = apply(kernel, raw[source])
        self._count(samples_out=len(out["position"].T))
        channels: dict[str, Any] = {"effort": None, **{name: values.T for name, values in out.items()}}
        time = block.time[self.window.half : len(block.time) - self.window.half]
        return Processed(time, self.joints, report=self.report, source=self.source, **channels)
