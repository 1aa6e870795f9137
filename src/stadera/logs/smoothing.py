"""Low-pass filters and thins equations: regressor rows and their targets, through the same filter.

An equation A(t) θ = b(t) that holds at every time also holds for filtered A and b. Filtering after the regressors were
computed from lightly filtered signals preserves terms that are nonlinear in the motion (above all the Coulomb column,
sign(dq)), which strong filtering of the signals would distort. After thinning to twice the cut-off, the noise of
neighbouring rows is nearly independent, as least squares assumes, and there are fewer rows to add.
"""

from collections.abc import Iterable, Iterator

import numpy as np
from scipy import signal

from stadera.errors import RecordingError
from stadera.logs.filters import low_pass
from stadera.logs.sampling import Sampling, segments, windows
from stadera.types import Array


def smooth_rows(
    chunks: Iterable[tuple[Array, Array]], rate_hz: float, cutoff_hz: float, every: int | None = None
) -> Iterator[tuple[Array, Array]]:
    """Filters consecutive chunks of rows, time (samples,) [s], even except for gaps, and values (samples, ...), without
    delay; yields time (kept,) and values (kept, ...).

    Chunks give the same result as the whole; nothing is filtered across a gap. Rows without a full window (2.17 /
    cut-off before and after [s]) are dropped. One row in `every` is kept, counted from the first of each stretch; None:
    so that the rate is twice the cut-off. RecordingError for a cut-off as in `low_pass`, or `every` below one.
    """
    kernel = low_pass(rate_hz, cutoff_hz)
    step = max(1, int(rate_hz / (2 * cutoff_hz))) if every is None else every
    if step < 1:
        raise RecordingError(f"one row in {step} cannot be kept; needs to be at least 1")
    shape: tuple[int, ...] = ()

    def flat() -> Iterator[tuple[Array, Array]]:
        nonlocal shape
        for time, values in chunks:
            if len(time):
                shape = values.shape[1:]
                yield time, values.reshape(len(time), -1).T

    half, seen = len(kernel) // 2, 0
    sampling = Sampling(1 / rate_hz, even=True, tolerance=0.5, gap_factor=1.5)
    for block in windows(segments(flat(), sampling), half):
        seen = 0 if block.start else seen
        first = -seen % step
        rows = len(block.time) - 2 * half
        if first < rows:
            kept = _correlate_every(kernel, block.values[:, first:], step)
            yield block.time[half + first : half + rows : step], np.ascontiguousarray(kept.T).reshape(-1, *shape)
        seen += rows


def _correlate_every(kernel: Array, values: Array, step: int) -> Array:
    """Every step-th correlation with a complete window, starting with the first; the kernel is symmetric."""
    lead = -(len(kernel) - 1) % step  # so that the first whole window is one of those computed
    padded = np.pad(values, ((0, 0), (lead, 0)))
    full: Array = signal.upfirdn(kernel, padded, down=step, axis=1)
    first = (lead + len(kernel) - 1) // step
    count = (values.shape[1] - len(kernel)) // step + 1
    return full[:, first : first + count]
