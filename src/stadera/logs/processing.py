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
from stadera.logs.filters import Kernels, apply, kernels
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
        if self.cutoff_hz is not None and not (np.isfinite(self.cutoff_hz) and self.cutoff_hz > 0):
            raise RecordingError(f"cut-off needs to be above 0 Hz, got {self.cutoff_hz:g}")
        if not abs(self.effort_delay) <= LONGEST_DELAY:
            raise RecordingError(
                f"effort_delay needs to be within {LONGEST_DELAY:g} s either way, got {self.effort_delay:g}"
            )


@dataclass
class PreprocessingReport:
    """Report on the preprocessing of a log; its counts grow while chunks are read."""

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
    sampling, names = sampling_of(head.time, head.source), tuple(joints) if joints is not None else head.joints
    recorded = ("velocity", "acceleration") if settings.cutoff_hz is None else ()
    channels = ["position", *(c for c in (*recorded, "effort") if getattr(head, c) is not None)]
    derivatives, delay = not {"velocity", "acceleration"} <= set(channels), settings.effort_delay
    window = kernels(sampling.rate_hz, settings.cutoff_hz, derivatives=derivatives, delay=delay)
    length, notes = 2 * window.half + 1, dict[str, None]()
    report = PreprocessingReport(sampling.rate_hz, settings.cutoff_hz, not sampling.even, length, delay)

    def stacks() -> Iterator[tuple[Array, Array]]:
        for chunk in chain([head], chunks):
            report.samples_in += len(chunk)
            notes.update(dict.fromkeys(chunk.notes))
            yield chunk.time, np.concatenate([chunk.channel(name, names).T for name in channels])

    def counted(blocks: Iterable[Block]) -> Iterator[Block]:
        samples = 0
        for block in blocks:
            samples = len(block.time) + (0 if block.start else samples)
            report.segments += block.start
            report.short_segments += block.end and samples < length
            yield block

    blocks = segments(stacks(), sampling)
    blocks = blocks if sampling.even else resampled(blocks, sampling.period)
    pending: Processed | None = None
    for block in windows(counted(blocks), window.half):
        if pending is not None:
            yield pending
        time = block.time[window.half : len(block.time) - window.half]
        report.samples_out += len(time)
        pending = Processed(time, names, report=report, source=head.source, **_filtered(block, channels, window))
    if pending is None:
        raise RecordingError(
            f"{head.source}: too few samples: {report.samples_in} in {report.segments} "
            f"stretch{'es' * (report.segments != 1)} without a gap, none as long as the {length} samples "
            f"({length * sampling.period:.3g} s) that the filter needs"
        )
    yield replace(pending, notes=(*notes, *report.notes))


def _filtered(block: Block, channels: Sequence[str], window: Kernels) -> dict[str, Any]:
    """Every channel filtered; velocity and acceleration by the derivative kernels if they are not recorded."""
    raw = dict(zip(channels, np.split(block.values, len(channels)), strict=True))
    out = {name: apply(window.late if name == "effort" else window.value, rows) for name, rows in raw.items()}
    if "velocity" not in raw:
        out["velocity"] = apply(window.first, raw["position"])
    if "acceleration" not in raw:
        kernel, source = (window.first, "velocity") if "velocity" in raw else (window.second, "position")
        out["acceleration"] = apply(kernel, raw[source])
    return {"effort": None, **{name: values.T for name, values in out.items()}}
