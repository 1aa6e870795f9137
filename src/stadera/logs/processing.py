"""Prepares a log for regressors: even sampling, filtering, differentiation, removal of samples at rest.

After section IV.B of Tournois et al. (IROS 2017): all variables go through one zero-delay low-pass filter, and samples
with all joints at rest are removed (their friction is undetermined). Reading in chunks gives the same result as reading
the whole log.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from typing import Any, Literal

import numpy as np

from stadera.errors import RecordingError
from stadera.logs.filters import apply, kernels
from stadera.logs.recording import Recording, concatenate
from stadera.logs.sampling import GAP_FACTOR, HEAD, Block, resampled, sampling_of, segments, windows
from stadera.types import Array

LONGEST_DELAY = 0.2
"""Longest plausible delay [s]; a larger one indicates another recording's clock."""


@dataclass(frozen=True)
class Preprocessing:
    """Settings for preparing a log for regressors. Raises RecordingError: a setting is out of its range."""

    # -3 dB frequency of the low-pass filter [Hz]. None for no filter: recorded velocities and accelerations are used
    # unchanged, and missing ones are computed by central differences.
    cutoff_hz: float | None
    drop_below: float = 0.01  # samples with all joint velocities below this are removed [rad/s]; 0 keeps all
    # with a filter, the signal that is differentiated: "position" (for velocity and acceleration) or "velocity" (for
    # the acceleration)
    derive_from: Literal["position", "velocity"] = "position"
    # delay of the effort at the joint relative to its stamp [s]: positive for commands that reach the motor late,
    # negative for sensors that report late
    effort_delay: float = 0.0
    # "auto" resamples a log with uneven stamps to an even grid; or "always", "never"
    resample: Literal["auto", "always", "never"] = "auto"
    tolerance: float = 0.01  # largest deviation of an even log's steps, as a share of a period
    gap_factor: float = GAP_FACTOR  # number of periods above which a step is a gap

    def __post_init__(self) -> None:
        """Validates the settings."""
        if self.cutoff_hz is not None and not (np.isfinite(self.cutoff_hz) and self.cutoff_hz > 0):
            raise RecordingError(f"cut-off needs to be above 0 Hz, got {self.cutoff_hz:g}")
        if not self.drop_below >= 0:
            raise RecordingError(f"drop_below needs to be at least 0 rad/s, got {self.drop_below:g}")
        for name, valid in (("derive_from", ("position", "velocity")), ("resample", ("auto", "always", "never"))):
            if getattr(self, name) not in valid:
                raise RecordingError(f"unknown {name} {getattr(self, name)!r}; valid: {', '.join(valid)}")
        if not abs(self.effort_delay) <= LONGEST_DELAY:
            raise RecordingError(
                f"effort_delay needs to be within {LONGEST_DELAY:g} s either way, got {self.effort_delay:g}"
            )
        if not 0 < self.tolerance < 0.5:
            raise RecordingError(f"tolerance needs to be between 0 and 0.5 periods, got {self.tolerance:g}")
        if not self.gap_factor > 1:
            raise RecordingError(f"gap factor needs to be above 1, got {self.gap_factor:g}")


@dataclass(frozen=True)
class PreprocessingReport:
    """Report on the preprocessing of a log, up to and including the chunk that carries it."""

    rate_hz: float  # of the result [Hz]
    cutoff_hz: float | None  # -3 dB [Hz], None where not filtered
    resampled: bool  # True if values were interpolated to an even grid
    window: int  # samples that the filter and the differences need for each output sample
    drop_below: float  # threshold of rest [rad/s]
    effort_delay: float = 0.0  # by which the effort was shifted [s]
    samples_in: int = 0  # samples read
    segments: int = 0  # stretches without a gap
    short_segments: int = 0  # segments shorter than the filter's window, which were dropped
    filtered: int = 0  # samples after filtering, before removal of those at rest
    at_rest: int = 0  # samples removed because all joints were slower than the threshold

    @property
    def samples_out(self) -> int:
        """Samples of the result."""
        return self.filtered - self.at_rest

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
        if self.at_rest:
            notes.append(f"dropped {self.at_rest} samples with all joints below {self.drop_below:g} rad/s")
        notes.append(f"{self.samples_out} of {self.samples_in} samples at {self.rate_hz:.6g} Hz are left")
        return tuple(notes)


@dataclass(frozen=True, eq=False)
class Processed:
    """Signals of the selected joints, all through the same filter, with notes of the log and of the report, whose last
    chunk covers the whole log.
    """

    time: Array  # (samples,) [s]; steps are uneven where samples were dropped
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
        elif settings.derive_from == "velocity":
            self.channels.append("velocity")
        if head.effort is not None:
            self.channels.append("effort")
        even = {"auto": None, "always": False, "never": True}[settings.resample]
        self.sampling = sampling_of(head.time, settings.tolerance, settings.gap_factor, even, head.source)
        derivatives = not {"velocity", "acceleration"} <= set(self.channels)
        rate_hz, delay = self.sampling.rate_hz, settings.effort_delay
        self.window = kernels(rate_hz, settings.cutoff_hz, derivatives=derivatives, delay=delay)
        self.notes: dict[str, None] = {}
        self.report = PreprocessingReport(
            rate_hz, settings.cutoff_hz, not self.sampling.even, 2 * self.window.half + 1, settings.drop_below, delay
        )

    def over(self, chunks: Iterable[Recording]) -> Iterator[Processed]:
        """Yields the results of consecutive chunks; the last one has the report on the whole log."""
        blocks = segments(self._stacks(chunks), self.sampling)
        if not self.sampling.even:
            blocks = resampled(blocks, self.sampling.period)
        pending: Processed | None = None
        for block in windows(self._counted(blocks), self.window.half):
            result = self._moving(self._differentiated(block))
            if len(result):
                if pending is not None:
                    yield pending
                pending = result
            elif pending is None or not len(pending):
                pending = result  # nothing moves so far: an empty result still carries the report
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

    def _differentiated(self, block: Block) -> dict[str, Array]:
        """Every channel filtered; velocity and acceleration by the derivative kernels if they are not recorded."""
        window = self.window
        raw = dict(zip(self.channels, np.split(block.values, len(self.channels)), strict=True))
        out = {name: apply(window.late if name == "effort" else window.value, rows) for name, rows in raw.items()}
        if "velocity" not in raw:
            out["velocity"] = apply(window.first, raw["position"])
        if "acceleration" not in raw:
            kernel, source = (window.first, "velocity") if "velocity" in raw else (window.second, "position")
            out["acceleration"] = apply(kernel, raw[source])
        return out | {"time": block.time[window.half : len(block.time) - window.half]}

    def _moving(self, signals: dict[str, Array]) -> Processed:
        """The samples at which some joint moves."""
        moving = np.any(np.abs(signals["velocity"]) >= self.settings.drop_below, axis=0)
        self._count(filtered=len(moving), at_rest=int(np.count_nonzero(~moving)))
        if not moving.all():
            signals = {name: values[..., moving] for name, values in signals.items()}
        channels: dict[str, Any] = {"effort": None, **{name: values.T for name, values in signals.items()}}
        return Processed(joints=self.joints, report=self.report, source=self.source, **channels)
