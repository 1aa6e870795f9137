"""From a log to the signals that regressors take: even, filtered, differentiated, without the samples at rest.

After section IV.B of Tournois et al. (IROS 2017): all variables through one zero-delay low-pass filter, samples with
all joints at rest removed (their friction is undetermined). A log read in chunks gives what the whole log gives.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import chain
from typing import Literal

import numpy as np

from stadera.errors import RecordingError
from stadera.recording.filters import Kernels, apply, kernels
from stadera.recording.join import concatenate
from stadera.recording.recording import Array, Recording
from stadera.recording.sampling import GAP_FACTOR, HEAD, Block, Sampling, resampled, sampling_of, segments


@dataclass(frozen=True)
class Preprocessing:
    """What is done to a log before regressors are made of it.

    Attributes:
        cutoff_hz: where the low-pass filter is at -3 dB [Hz]. None: no filter; recorded velocities and accelerations
            are taken as they are, missing ones are central differences.
        drop_below: samples with all joint velocities below this are dropped [rad/s]; 0 keeps all.
        derive_from: with a filter, the signal whose derivatives the others are: "position" (velocity and acceleration
            are its derivatives) or "velocity" (the acceleration is its derivative).
        resample: "auto" puts a log of uneven stamps on an even grid, "always" and "never" do as they say.
        tolerance: the share of a period that an even log's steps may be off.
        gap_factor: a step of more periods than this is a gap.

    Raises:
        RecordingError: a setting out of its range.
    """

    cutoff_hz: float | None
    drop_below: float = 0.01
    derive_from: Literal["position", "velocity"] = "position"
    resample: Literal["auto", "always", "never"] = "auto"
    tolerance: float = 0.01
    gap_factor: float = GAP_FACTOR

    def __post_init__(self) -> None:
        """Validated where made."""
        if self.cutoff_hz is not None and not (np.isfinite(self.cutoff_hz) and self.cutoff_hz > 0):
            raise RecordingError(f"cut-off needs to be above 0 Hz, got {self.cutoff_hz:g}")
        if not self.drop_below >= 0:
            raise RecordingError(f"drop_below needs to be at least 0 rad/s, got {self.drop_below:g}")
        for name, valid in (("derive_from", ("position", "velocity")), ("resample", ("auto", "always", "never"))):
            if getattr(self, name) not in valid:
                raise RecordingError(f"unknown {name} {getattr(self, name)!r}; valid: {', '.join(valid)}")
        if not 0 < self.tolerance < 0.5:
            raise RecordingError(f"tolerance needs to be between 0 and 0.5 periods, got {self.tolerance:g}")
        if not self.gap_factor > 1:
            raise RecordingError(f"gap factor needs to be above 1, got {self.gap_factor:g}")


@dataclass(frozen=True)
class PreprocessingReport:
    """What was done to a log, up to and including the chunk that carries this report.

    Attributes:
        rate_hz: of the result [Hz].
        cutoff_hz: -3 dB [Hz], None where not filtered.
        resampled: whether values were interpolated onto an even grid.
        samples_in: read.
        segments: stretches without a gap.
        short_segments: of these, too short for one window of the filter, and dropped.
        window: samples that the filter and the differences need for one.
        filtered: samples after filtering, before those at rest were dropped.
        at_rest: dropped, all joints slower than the threshold.
        samples_out: the result's.
    """

    rate_hz: float
    cutoff_hz: float | None
    resampled: bool
    window: int
    drop_below: float
    samples_in: int = 0
    segments: int = 0
    short_segments: int = 0
    filtered: int = 0
    at_rest: int = 0

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
    """Signals of the chosen joints, all through the same filter.

    Attributes:
        time: (samples,) [s]; steps are uneven where samples were dropped.
        joints: names, n of them.
        position, velocity, acceleration: (samples, n) [rad, rad/s, rad/s²].
        effort: (samples, n) [N·m], None where not recorded.
        report: what was done so far; the last chunk's covers the whole log.
        source: of the log.
        notes: the log's own and the report's.
    """

    time: Array
    joints: tuple[str, ...]
    position: Array
    velocity: Array
    acceleration: Array
    effort: Array | None
    report: PreprocessingReport
    source: str = "recording"
    notes: tuple[str, ...] = field(default=())

    def __len__(self) -> int:
        return len(self.time)


def preprocess(recording: Recording, settings: Preprocessing, joints: Sequence[str] | None = None) -> Processed:
    """Preprocess a whole recording.

    Args:
        recording: the log.
        settings: what to do.
        joints: the joints to keep, in this order; None for all.

    Raises:
        RecordingError: too few samples for the filter, a cut-off too high for the sampling rate, no sample that moves.
        UnknownNameError: a joint that is not recorded.
    """
    parts = tuple(preprocess_stream([recording], settings, joints))
    last = parts[-1]
    if len(parts) == 1:
        return last

    def joined(name: str) -> Array:
        return np.concatenate([getattr(part, name) for part in parts])

    return replace(
        last,
        time=joined("time"),
        position=joined("position"),
        velocity=joined("velocity"),
        acceleration=joined("acceleration"),
        effort=None if last.effort is None else joined("effort"),
    )


def preprocess_stream(
    chunks: Iterable[Recording], settings: Preprocessing, joints: Sequence[str] | None = None
) -> Iterator[Processed]:
    """Preprocess consecutive chunks of one log; the results put together are those of the whole log.

    Memory is flat in the log's length. The rate, and whether stamps are uneven, is decided on the first 4096 samples.
    Arguments and errors as `preprocess`.
    """
    head, rest = _head(iter(chunks))
    names = tuple(joints) if joints is not None else head.joints
    even = {"auto": None, "always": False, "never": True}[settings.resample]
    sampling = sampling_of(head.time, settings.tolerance, settings.gap_factor, even)
    return _run(chain([head], rest), _plan(head, names, settings, sampling))


@dataclass(frozen=True, eq=False)
class _Plan:
    """What a log's first chunk decides for all of it."""

    joints: tuple[str, ...]
    channels: tuple[str, ...]  # stacked in this order, each with a row for every joint
    settings: Preprocessing
    sampling: Sampling
    window: Kernels


@dataclass
class _Tally:
    """What one run has seen so far."""

    report: PreprocessingReport
    notes: dict[str, None] = field(default_factory=dict)

    def add(self, **counts: int) -> None:
        self.report = replace(self.report, **{name: getattr(self.report, name) + n for name, n in counts.items()})


def _plan(head: Recording, joints: tuple[str, ...], settings: Preprocessing, sampling: Sampling) -> _Plan:
    channels = ["position"]
    if settings.cutoff_hz is None:
        channels += [name for name in ("velocity", "acceleration") if getattr(head, name) is not None]
    elif settings.derive_from == "velocity":
        channels.append("velocity")
    if head.effort is not None:
        channels.append("effort")
    derivatives = not {"velocity", "acceleration"} <= set(channels)
    window = kernels(sampling.rate_hz, settings.cutoff_hz, derivatives=derivatives)
    return _Plan(joints, tuple(channels), settings, sampling, window)


def _head(chunks: Iterator[Recording]) -> tuple[Recording, Iterator[Recording]]:
    """The first HEAD samples or more as one recording, and the chunks after it."""
    parts: list[Recording] = []
    while sum(map(len, parts)) < HEAD and (chunk := next(chunks, None)) is not None:
        parts.append(chunk)
    if not parts:
        raise RecordingError("too few samples: none")
    return concatenate(parts), chunks


def _run(chunks: Iterator[Recording], plan: _Plan) -> Iterator[Processed]:
    sampling, source = plan.sampling, "recording"
    tally = _Tally(
        PreprocessingReport(
            rate_hz=sampling.rate_hz,
            cutoff_hz=plan.settings.cutoff_hz,
            resampled=not sampling.even,
            window=2 * plan.window.half + 1,
            drop_below=plan.settings.drop_below,
        )
    )

    def stacks() -> Iterator[tuple[Array, Array]]:
        nonlocal source
        for chunk in chunks:
            source = chunk.source
            tally.add(samples_in=len(chunk))
            tally.notes |= dict.fromkeys(chunk.notes)
            yield chunk.time, np.concatenate([chunk.channel(name, plan.joints).T for name in plan.channels])

    blocks = segments(stacks(), sampling)
    if not sampling.even:
        blocks = resampled(blocks, sampling.period)
    pending: Processed | None = None
    for block in _windows(blocks, plan.window.half, tally):
        result = _moving(_differentiated(block, plan), source, plan, tally)
        if len(result):
            if pending is not None:
                yield pending
            pending = result
        elif pending is None or not len(pending):
            pending = result  # nothing moves so far: an empty result still says what was done
    if pending is None:
        window = tally.report.window
        raise RecordingError(
            f"{source}: too few samples: {tally.report.samples_in} in {tally.report.segments} "
            f"stretch{'es' * (tally.report.segments != 1)} without a gap, "
            f"none as long as the {window} samples ({window * sampling.period:.3g} s) that the filter needs"
        )
    yield replace(pending, report=tally.report, notes=(*tally.notes, *tally.report.notes))


def _windows(blocks: Iterable[Block], half: int, tally: _Tally) -> Iterator[Block]:
    """Blocks long enough for the filter: each overlaps the one before, of its segment, by a window less one sample."""
    kept: Block | None = None
    for fresh in blocks:
        tally.add(segments=fresh.start)
        block = fresh.after(kept)
        samples = len(block.time)
        if samples > 2 * half:
            yield block
            kept = block.between(samples - 2 * half, samples, start=False, end=False)
        else:
            kept = block
            tally.add(short_segments=block.start and block.end)


def _differentiated(block: Block, plan: _Plan) -> dict[str, Array]:
    """Every channel filtered, velocity and acceleration by the derived kernels where they are not stacked."""
    n, half = len(plan.joints), plan.window.half
    value, first, second = plan.window.kernels
    raw = {name: block.values[i * n : (i + 1) * n] for i, name in enumerate(plan.channels)}
    out = {name: apply(value, rows) for name, rows in raw.items()}
    if "velocity" not in raw:
        out["velocity"] = apply(first, raw["position"])
    if "acceleration" not in raw:
        out["acceleration"] = apply(first, raw["velocity"]) if "velocity" in raw else apply(second, raw["position"])
    return out | {"time": block.time[half : len(block.time) - half]}


def _moving(signals: dict[str, Array], source: str, plan: _Plan, tally: _Tally) -> Processed:
    """The samples at which some joint moves."""
    moving = np.any(np.abs(signals["velocity"]) >= plan.settings.drop_below, axis=0)
    tally.add(filtered=len(moving), at_rest=int(np.count_nonzero(~moving)))
    if not moving.all():
        signals = {name: values[..., moving] for name, values in signals.items()}
    return Processed(
        time=signals["time"],
        joints=plan.joints,
        position=signals["position"].T,
        velocity=signals["velocity"].T,
        acceleration=signals["acceleration"].T,
        effort=signals["effort"].T if "effort" in signals else None,
        report=tally.report,
        source=source,
    )
