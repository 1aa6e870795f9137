"""Replaces spikes: single values that a sensor or a message got wrong, and that no motion explains.

The median of three equals the sample where a signal is monotonic, so only peaks of one sample can be spikes, and of
these only those beyond ten times the channel's usual noise, estimated from third differences. An impact is a peak too:
on hard ground a touchdown accelerates trunk and joints within one or two samples, and without it the mean specific
force of a trot would be up to a tenth too small, and the trunk as much too heavy. But an impact shows in several
channels at once. So a peak is a spike if it is alone, or if its sample is impossible: a joint's position jumps there
and back faster than any joint turns. Spikes are replaced by the mean of their neighbours.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from stadera.trunk.noise import third_differences_squared
from stadera.trunk.samples import Samples
from stadera.types import Array, Bools

_CHANNELS = ("position", "velocity", "effort", "angular_velocity", "specific_force", "extra")


@dataclass(frozen=True)
class SpikeSettings:
    """Settings of the replacement of spikes.

    Attributes:
        wild: size of a spike, times the usual noise.
        restless: size of a peak in another channel of the sample or its neighbours, as in an impact, times the usual
            noise.
        fastest: speed that no joint reaches [rad/s]; those of legged robots turn at up to 20 to 30 (data sheets of Go2,
            A1, ANYmal).
        memory: blocks over which the usual noise is averaged. learnt: blocks before any spike is replaced.
    """

    wild: float = 10.0
    restless: float = 4.0
    fastest: float = 30.0
    memory: float = 100.0
    learnt: int = 5


class SpikeFilter:
    """Removes spikes block by block; `settings` None for the defaults.

    Attributes:
        replaced: number of samples of which values were replaced so far.
        squares: mean squares of third differences of all channels of the last block; None of less than four samples.
    """

    def __init__(self, settings: SpikeSettings | None = None) -> None:
        self._settings = settings or SpikeSettings()
        self._usual: Array | None = None
        self.squares: Array | None = None
        self._blocks = self.replaced = 0

    def clean(self, samples: Samples) -> Samples:
        """Returns the samples without spikes; a block has one more sample before and after it."""
        self.squares = None
        if len(samples) < 4:
            return samples
        self._blocks += 1
        settings = self._settings
        channels = [getattr(samples, name) for name in _CHANNELS]
        values, usual, cleaned = np.hstack(channels), self._usual, False
        if usual is not None and self._blocks > settings.learnt:
            steps = values[1:] - values[:-1]
            away = np.abs(steps)
            deviation = np.empty_like(values)
            # |now - median|: the distance to the nearer neighbour where it is a peak, else zero
            deviation[1:-1] = np.where(steps[:-1] * steps[1:] < 0.0, np.minimum(away[:-1], away[1:]), 0.0)
            deviation[0], deviation[-1] = 0.5 * np.abs(steps[0] - steps[1]), 0.5 * np.abs(steps[-1] - steps[-2])
            noise = np.sqrt(usual)
            wild = deviation > settings.wild * noise
            if wild.any():
                impossible = settings.fastest * float(samples.time[1] - samples.time[0])
                wild &= _alone(deviation > settings.restless * noise) | (
                    deviation[:, : samples.position.shape[1]] > impossible
                ).any(axis=1, keepdims=True)
            if cleaned := bool(wild.any()):
                self.replaced += int(wild[1:-1].any(axis=1).sum())  # the others belong to other blocks
                expected = np.empty_like(values)
                expected[1:-1] = 0.5 * (values[:-2] + values[2:])
                expected[0], expected[-1] = 2.0 * values[1] - values[2], 2.0 * values[-2] - values[-3]
                values = np.where(wild, expected, values)
        self.squares = third_differences_squared(values)
        square = self.squares + 1e-12
        self._usual = square if usual is None else usual + (square - usual) / min(self._blocks, settings.memory)
        if not cleaned:
            return samples
        edges = np.cumsum([channel.shape[1] for channel in channels[:-1]])
        return replace(samples, **dict(zip(_CHANNELS, np.split(values, edges, axis=1), strict=True)))


def _alone(restless: Bools) -> Bools:
    """True where no other channel (samples, channels) is restless in the same sample, the one before or the one
    after.
    """
    around = restless.astype(int)
    around[1:] += restless[:-1]
    around[:-1] += restless[1:]
    return np.asarray(around.sum(axis=1, keepdims=True) == around)
