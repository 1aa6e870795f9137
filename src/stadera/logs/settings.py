"""Settings and report of preprocessing."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from stadera.errors import RecordingError
from stadera.logs.sampling import GAP_FACTOR

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
