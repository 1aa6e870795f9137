"""Zero-delay low-pass filtering and differentiation by finite, symmetric kernels; the cut-off.

Every kernel has an odd number of taps around the sample, so the delay is zero and a sample depends only on neighbours
within half a window: filtering overlapping chunks gives the same result as filtering the whole log, and samples without
a full window are known and can be trimmed.

Position q, its derivatives and every other signal x go through the same low-pass filter h:

    q_f = h * q,    dq_f = d1 * (h * q),    ddq_f = d2 * (h * q),    x_f = h * x,

with d1 and d2 the 9-point central differences. An equation that is linear in the signals and their derivatives also
holds for the filtered ones.
"""

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import optimize, signal
from scipy.special import chdtri

from stadera.errors import RecordingError
from stadera.logs.recording import Recording
from stadera.logs.sampling import Block, Sampling, resampled, sampling_of, segments, windows
from stadera.types import Array

RATES_PER_CUTOFF = 8.0
"""Least ratio of sampling rate to cut-off, for which the central differences are accurate to 3e-4."""

_FIRST_HALF = np.array([4 / 5, -1 / 5, 4 / 105, -1 / 280])
_SECOND_HALF = np.array([8 / 5, -1 / 5, 8 / 315, -1 / 560])
FIRST_DIFFERENCE: Array = np.concatenate([-_FIRST_HALF[::-1], [0.0], _FIRST_HALF])
SECOND_DIFFERENCE: Array = np.concatenate([_SECOND_HALF[::-1], [-205 / 72], _SECOND_HALF])
"""Central differences of eighth order on nine points (B. Fornberg, Math. Comp. 51, 1988), for a unit step."""


@dataclass(frozen=True, eq=False)
class Kernels:
    """Filter, its first and second derivative [1/s, 1/s²], and the filter applied to the signal a fixed time earlier,
    on one window, each (2 half + 1,), to be correlated with samples.
    """

    value: Array
    first: Array
    second: Array
    late: Array
    half: int


def kernels(rate_hz: float, cutoff_hz: float | None, *, derivatives: bool = True, delay: float = 0.0) -> Kernels:
    """Computes the kernels for a sampling rate [Hz]; without a cut-off, the frequency of -3 dB [Hz], the filter is the
    identity.

    Without `derivatives` the taps that the central differences need are omitted, and the derivatives zero. `late` looks
    back by `delay` [s]; negative looks ahead. Raises as `low_pass`.
    """
    taps = np.ones(1) if cutoff_hz is None else low_pass(rate_hz, cutoff_hz)
    rows = [taps, np.zeros(1), np.zeros(1), taps]
    if derivatives:
        rows[1] = rate_hz * np.convolve(taps, FIRST_DIFFERENCE)
        rows[2] = rate_hz**2 * np.convolve(taps, SECOND_DIFFERENCE)
    if delay != 0.0:
        rows[3] = np.convolve(taps, shift(-delay * rate_hz))
    half = max(len(row) for row in rows) // 2
    value, first, second, late = (np.pad(row, half - len(row) // 2) for row in rows)
    return Kernels(value, first, second, late, half)


def shift(steps: float) -> Array:
    """Kernel that shifts a signal by `steps` samples: Lagrange's polynomial through the eight samples around.

    Accurate to 3e-4 for signals up to an eighth of the sampling rate.
    """
    nodes = math.floor(steps) + np.arange(-3, 5)
    weights = [np.prod([(steps - b) / (a - b) for b in nodes if b != a]) for a in nodes]
    half = int(np.abs(nodes).max())
    kernel = np.zeros(2 * half + 1)
    kernel[nodes + half] = weights
    return kernel


def low_pass(
    rate_hz: float, cutoff_hz: float, stop_band_db: float = 70.0, width: float = 4.34, tolerance: float = 5e-4
) -> Array:
    """A symmetric windowed-sinc low-pass filter with unit gain at rest and -3 dB at the cut-off. RecordingError for a
    cut-off that is not positive or above an eighth of the sampling rate.

    With a Kaiser window for 70 dB, amplitudes up to half the cut-off pass within 0.05 %; above one and a half times the
    cut-off they are below 0.05 %.

    Args:
        stop_band_db: of the Kaiser window [dB].
        width: of the window times the cut-off [1]: Kaiser's estimate for this stop band and a transition as wide as the
            cut-off.
        tolerance: by how much the rates of two parts of one log may differ [1]: stamps rounded to 1 ms, over 1000
            samples at 500 Hz.
    """
    if not 0 < cutoff_hz <= (1 + tolerance) * rate_hz / RATES_PER_CUTOFF:
        raise RecordingError(
            f"cut-off {cutoff_hz:g} Hz: needs to be above 0 and at most {rate_hz / RATES_PER_CUTOFF:g} Hz, "
            f"an eighth of the sampling rate"
        )
    half = math.ceil(width * rate_hz / cutoff_hz / 2)
    window = ("kaiser", signal.kaiser_beta(stop_band_db))
    cosines = np.cos(2 * np.pi * cutoff_hz / rate_hz * np.arange(-half, half + 1))

    def taps(middle: float) -> Array:
        # firwin's own cut-off is where the amplitude is one half
        return np.asarray(signal.firwin(2 * half + 1, middle, window=window, fs=rate_hz), dtype=np.float64)

    def excess(middle: float) -> float:
        return float(cosines @ taps(middle)) - math.sqrt(0.5)

    return taps(float(optimize.brentq(excess, cutoff_hz, 1.5 * cutoff_hz, xtol=1e-9 * cutoff_hz)))


def apply(kernel: Array, values: Array) -> Array:
    """Correlates rows (channels, samples) with a kernel (2 half + 1,), where the whole window is available, (channels,
    samples - 2 half).
    """
    if len(kernel) == 1:
        return values  # the identity
    return np.asarray(signal.oaconvolve(values, kernel[np.newaxis, ::-1], mode="valid", axes=1))


def smooth_rows(
    chunks: Iterable[tuple[Array, Array]], rate_hz: float, cutoff_hz: float
) -> Iterator[tuple[Array, Array]]:
    """Filters consecutive chunks of rows, time (samples,) [s], even except for gaps, and values (samples, columns),
    without delay; yields time (kept,) and values (kept, columns).

    Chunks give the same result as the whole; nothing is filtered across a gap. Rows without a full window (2.17 /
    cut-off before and after [s]) are dropped. Rows are kept at twice the cut-off, counted from the first of each
    stretch. RecordingError for a cut-off as in `low_pass`.
    """
    kernel = low_pass(rate_hz, cutoff_hz)
    step = max(1, int(rate_hz / (2 * cutoff_hz)))
    half, seen = len(kernel) // 2, 0
    stacks = ((time, values.T) for time, values in chunks if len(time))
    for block in windows(segments(stacks, Sampling(1 / rate_hz, even=True, tolerance=0.5)), half):
        seen = 0 if block.start else seen
        rows = len(block.time) - 2 * half
        kept = slice(-seen % step, None, step)
        time = block.time[half : half + rows][kept]
        if len(time):
            yield time, np.ascontiguousarray(apply(kernel, block.values)[:, kept].T)
        seen += rows


@dataclass(frozen=True)
class CutoffSettings:
    """Criteria for motion in a spectrum."""

    power_share: float = 0.99  # share of the velocity's power that the filter must pass unchanged
    # lowest cut-off suggested [Hz]: Coulomb friction changes sign abruptly, whatever the motion's frequency
    lowest_hz: float = 5.0
    stretch: float = 10.0  # length of the stretches whose spectra are averaged [s]; 10 s resolve 0.1 Hz
    noise_factor: float = 4.0  # multiple of the noise floor below which position power counts as noise
    # probability that noise alone exceeds its floor by more in any bin of any joint: few spectra averaged scatter by
    # more than that, and one false bin near the end of the band makes a filter that passes all noise
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
    sampling = sampling_of(recording.time, recording.source)
    position = recording.channel("position", tuple(joints) if joints is not None else recording.joints).T
    blocks = segments([(recording.time, position)], sampling)
    longest = max(blocks if sampling.even else resampled(blocks, sampling.period), key=lambda block: len(block.time))
    settings = settings or CutoffSettings()
    wanted = max(2.0 * _highest_motion(longest, sampling.rate_hz, settings), settings.lowest_hz)
    return min(float(np.floor(10 * wanted) / 10), sampling.rate_hz / RATES_PER_CUTOFF)


def highest_cutoff(recording: Recording) -> float:
    """The highest cut-off that the recording's sampling rate allows [Hz]."""
    rate_hz = sampling_of(recording.time, recording.source).rate_hz
    return rate_hz / RATES_PER_CUTOFF


def _highest_motion(block: Block, rate_hz: float, settings: CutoffSettings) -> float:
    """Frequency below which `power_share` of the fastest joint's velocity power lies [Hz]; 0 if nothing moves."""
    samples = min(len(block.time), round(settings.stretch * rate_hz))
    frequency, power = signal.welch(block.values, rate_hz, nperseg=samples, axis=1)
    floor = np.median(power[:, frequency >= rate_hz / 4], axis=1, keepdims=True)
    freedom = 2 * max(1, len(block.time) // samples)
    scatter = chdtri(freedom, settings.false_motion / power.size) / chdtri(freedom, 0.5)
    motion = (power > max(settings.noise_factor, scatter) * floor) & (frequency <= rate_hz / RATES_PER_CUTOFF)
    velocity_power: Array = np.where(motion, power - floor, 0.0) * (2 * np.pi * frequency) ** 2
    share = np.cumsum(velocity_power, axis=1)
    moving = share[:, -1] > 0
    if not moving.any():
        return 0.0
    reached = share[moving] >= settings.power_share * share[moving, -1:]
    return float(frequency[reached.argmax(axis=1)].max())
