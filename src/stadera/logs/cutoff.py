"""Suggests the cut-off of the low-pass filter from the motion's spectrum."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import signal
from scipy.special import chdtri

from stadera.logs.filters import RATES_PER_CUTOFF
from stadera.logs.recording import Recording
from stadera.logs.sampling import GAP_FACTOR, Block, resampled, sampling_of, segments
from stadera.types import Array


@dataclass(frozen=True)
class CutoffSettings:
    """Criteria for motion in a spectrum."""

    power_share: float = 0.99  # share of the velocity's power that the filter must pass unchanged
    # lowest cut-off suggested [Hz]: Coulomb friction changes sign abruptly, whatever the motion's frequency
    lowest_hz: float = 5.0
    stretch: float = 10.0  # length of the stretches whose spectra are averaged [s]; 10 s resolve 0.1 Hz
    noise_factor: float = 4.0  # multiple of the noise floor below which position power counts as noise
    # probability that noise alone exceeds its floor by more in any bin: few spectra averaged scatter by more than that
    false_motion: float = 0.01


def suggest_cutoff(
    recording: Recording, joints: Sequence[str] | None = None, settings: CutoffSettings | None = None
) -> float | None:
    """Suggests a cut-off [Hz] for these joints (None: all) that passes the motion unchanged and rejects noise; None if
    accelerations are recorded, which only simulations do, so that no filter is needed.

    The power spectrum P(f) of every joint's position (Welch) has a floor, the median over the upper half of the band,
    due to encoder noise and resolution. Power above it, up to the highest cut-off that the sampling rate allows, is
    motion, with velocity power (2π f)² P(f); above by more than K averaged spectra scatter, chi-squared with 2 K
    degrees of freedom, since the weight (2π f)² would make motion of the noise. The filter is flat up to half its
    cut-off, so the cut-off is twice the frequency below which 99 % of that power lies, for the fastest joint; at least
    5 Hz and at most an eighth of the sampling rate.

    Raises:
        RecordingError: fewer than two samples. UnknownNameError: a joint that is not recorded.
    """
    if recording.acceleration is not None:
        return None
    sampling = sampling_of(recording.time, tolerance=0.01, gap_factor=GAP_FACTOR, source=recording.source)
    position = recording.channel("position", tuple(joints) if joints is not None else recording.joints).T
    blocks = segments([(recording.time, position)], sampling)
    longest = max(blocks if sampling.even else resampled(blocks, sampling.period), key=lambda block: len(block.time))
    settings = settings or CutoffSettings()
    wanted = max(2.0 * _highest_motion(longest, sampling.rate_hz, settings), settings.lowest_hz)
    return min(float(np.floor(10 * wanted) / 10), sampling.rate_hz / RATES_PER_CUTOFF)


def highest_cutoff(recording: Recording) -> float:
    """The highest cut-off that the recording's sampling rate allows [Hz]."""
    rate_hz = sampling_of(recording.time, tolerance=0.01, gap_factor=GAP_FACTOR, source=recording.source).rate_hz
    return rate_hz / RATES_PER_CUTOFF


def _highest_motion(block: Block, rate_hz: float, settings: CutoffSettings) -> float:
    """Frequency below which `power_share` of the fastest joint's velocity power lies [Hz]; 0 if nothing moves."""
    samples = min(len(block.time), round(settings.stretch * rate_hz))
    frequency, power = signal.welch(block.values, rate_hz, nperseg=samples, axis=1)
    floor = np.median(power[:, frequency >= rate_hz / 4], axis=1, keepdims=True)
    freedom = 2 * max(1, len(block.time) // samples)
    scatter = chdtri(freedom, settings.false_motion / len(frequency)) / chdtri(freedom, 0.5)
    motion = (power > max(settings.noise_factor, scatter) * floor) & (frequency <= rate_hz / RATES_PER_CUTOFF)
    velocity_power: Array = np.where(motion, power - floor, 0.0) * (2 * np.pi * frequency) ** 2
    share = np.cumsum(velocity_power, axis=1)
    moving = share[:, -1] > 0
    if not moving.any():
        return 0.0
    reached = share[moving] >= settings.power_share * share[moving, -1:]
    return float(frequency[reached.argmax(axis=1)].max())
