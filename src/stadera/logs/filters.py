"""Zero-delay low-pass filtering and differentiation by finite, symmetric kernels.

Every kernel has an odd number of taps around the sample, so the delay is zero and a sample depends only on neighbours
within half a window: filtering overlapping chunks gives the same result as filtering the whole log, and samples without
a full window are known and can be trimmed.

Position q, its derivatives and every other signal x go through the same low-pass filter h:

    q_f = h * q,    dq_f = d1 * (h * q),    ddq_f = d2 * (h * q),    x_f = h * x,

with d1 and d2 the 9-point central differences. An equation that is linear in the signals and their derivatives also
holds for the filtered ones.
"""

import math
from dataclasses import dataclass

import numpy as np
from scipy import optimize, signal

from stadera.errors import RecordingError
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
