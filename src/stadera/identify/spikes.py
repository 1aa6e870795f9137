"""Replaces single outliers in a log, which would otherwise dominate after two differentiations."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from stadera.logs.recording import Recording

_USUAL = 0.99  # quantile of the steps from sample to sample that counts as usual
_WILD = 3.0  # times the usual step; of white Gaussian noise it is eleven standard deviations


def without_spikes(recording: Recording) -> Recording:
    """Replaces each outlier in the joint signals by the median of itself and its neighbours, and notes their number.

    An outlier is further from that median than its signal ever changes between two samples. A step equals its own
    median, so it is not an outlier.
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
