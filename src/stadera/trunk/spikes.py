"""Replaces spikes of a single sample, detected by their distance from the median of the sample and its neighbours.

The median of three equals the sample where a signal is monotonic, so only peaks of one sample are affected, and of
these only those beyond ten times the channel's usual noise, estimated from third differences. Spikes are replaced by
the mean of their neighbours, and counted.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from stadera.trunk.samples import Samples
from stadera.types import Array

_CHANNELS = ("position", "velocity", "effort", "angular_velocity", "specific_force")
_WILD = 10.0  # times the usual noise
_MEMORY = 100.0  # blocks
_LEARNT = 5  # blocks before any spike is replaced


class SpikeFilter:
    """Removes spikes block by block.

    Attributes:
        count: number of values replaced.
    """

    def __init__(self) -> None:
        self._usual: dict[str, Array] = {}
        self._blocks = 0
        self.count = 0

    def clean(self, samples: Samples) -> Samples:
        """Returns the samples without spikes; a block has one more sample before and after it."""
        if len(samples) < 4:
            return samples
        self._blocks += 1
        changed = {}
        for name in _CHANNELS:
            values = getattr(samples, name)
            expected = np.empty_like(values)
            expected[1:-1] = 0.5 * (values[:-2] + values[2:])
            expected[0], expected[-1] = 2.0 * values[1] - values[2], 2.0 * values[-2] - values[-3]
            deviation = np.empty_like(values)
            before, now, after = values[:-2], values[1:-1], values[2:]
            # |now - median|: the distance to the nearer neighbour where it is a peak, else zero
            peak = (now - before) * (now - after) > 0.0
            deviation[1:-1] = np.where(peak, np.minimum(np.abs(now - before), np.abs(now - after)), 0.0)
            deviation[[0, -1]] = 0.5 * np.abs(values[[0, -1]] - expected[[0, -1]])
            usual = self._usual.get(name)
            if usual is not None and self._blocks > _LEARNT:
                wild = deviation > _WILD * np.sqrt(usual)
                if wild.any():
                    self.count += int(wild[1:-1].sum())
                    changed[name] = np.where(wild, expected, values)
                    values = changed[name]
            square = (np.diff(values, 3, axis=0) ** 2).mean(axis=0) / 20.0 + 1e-12
            self._usual[name] = square if usual is None else usual + (square - usual) / min(self._blocks, _MEMORY)
        return replace(samples, **changed) if changed else samples
