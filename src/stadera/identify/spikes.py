"""Replaces single outliers in a log, which would otherwise dominate after two differentiations."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from stadera.errors import IdentificationError, require_positive
from stadera.logs.recording import Recording


@dataclass(frozen=True)
class SpikeSettings:
    """Settings that define which samples are spikes."""

    usual: float = 0.99  # quantile of a signal's steps between samples that defines its usual step [1]
    # distance from the median of three samples, in usual steps [1]; of white Gaussian noise 3 are eleven standard
    # deviations
    wild: float = 3.0

    def __post_init__(self) -> None:
        require_positive("spike setting", self, ("usual", "wild"))
        if self.usual > 1.0:
            raise IdentificationError(f"spike setting 'usual' is a quantile, at most 1, got {self.usual}")


def without_spikes(recording: Recording, settings: SpikeSettings | None = None) -> Recording:
    """Replaces each outlier in the joint signals by the median of itself and its neighbours, and notes their number.

    An outlier is further from that median than its signal ever changes between two samples. A step equals its own
    median, so it is not an outlier.
    """
    settings = settings or SpikeSettings()
    changed, count = {}, 0
    for channel in ("position", "velocity", "effort"):
        values = getattr(recording, channel)
        if values is None or len(recording) < 3:
            continue
        median = values.copy()
        median[1:-1] = np.median([values[:-2], values[1:-1], values[2:]], axis=0)
        usual = np.quantile(np.abs(np.diff(values, axis=0)), settings.usual, axis=0)
        wild = np.abs(values - median) > settings.wild * usual
        if wild.any():
            changed[channel], count = np.where(wild, median, values), count + int(wild.sum())
    if not count:
        return recording
    note = f"replaced {count} wild value{'s' * (count > 1)} of {', '.join(changed)}"
    return replace(recording, **changed, notes=(*recording.notes, note))
