"""Single wild samples of a log, which differentiated twice would outweigh seconds of motion."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from stadera.logs.recording import Recording

_USUAL = 0.99  # quantile of the steps from sample to sample that counts as usual
_WILD = 3.0  # times the usual step; of white Gaussian noise it is eleven standard deviations


def without_spikes(recording: Recording) -> Recording:
    """Joint signals with every wild sample replaced by the median of itself and its neighbours, and a note of how many.

    A sample is wild if it is further from that median than its signal ever goes from one sample to the next. A step is
    its own median, so not wild.
    """
    changed, count = {}, 0
    for channel in ("position", "velocity", "effort"):
        values = getattr(recording, channel)
        if values is None or len(recording) < 3:
            continue
        median = values.copy()
        median[1:-1] = np.median([values[:-2], values[1:-1], values[2:]], axis=0)
        usual = np.quantile(np.abs(np.diff(values, axis=0)), _USUAL, axis=0)
        wild = np.abs(values - median) > _WILD * usual
        if wild.any():
            changed[channel], count = np.where(wild, median, values), count + int(wild.sum())
    if not count:
        return recording
    note = f"replaced {count} wild value{'s' * (count > 1)} of {', '.join(changed)}"
    return replace(recording, **changed, notes=(*recording.notes, note))
