"""Replaces spikes: single values that a sensor or a message got wrong, and that no motion explains.

The median of three equals the sample where a signal is monotonic, so only peaks of one sample can be spikes, and of
these only those beyond ten times the channel's usual noise, estimated from third differences. An impact is a peak too:
on hard ground a touchdown accelerates trunk and joints within one or two samples, and without it the mean specific
force of a trot would be up to a tenth too small, and the trunk as much too heavy. But an impact shows in several
channels at once. So a peak is a spike if it is alone, or if its sample is impossible: a joint's position jumps there
and back faster than any joint turns. Spikes are replaced by the mean of their neighbours.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from stadera.trunk.noise import mean_third_differences_squared
from stadera.trunk.window import Window, window_of
from stadera.types import Array, Bools


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
    """

    def __init__(self, settings: SpikeSettings | None = None) -> None:
        self._settings = settings or SpikeSettings()
        self._usual: Array | None = None
        self._blocks = self.replaced = 0

    def clean(self, table: Array, sizes: tuple[int, ...], joints: int) -> tuple[Array, tuple[int, ...], Array | None]:
        """Takes in successive blocks up to the first one with a spike; that one alone, without it, if it is the first.

        Args:
            table: `Samples.table` of the blocks, with one sample more before and after them. sizes: of the blocks.
            joints: number of joints in the tree.

        Returns:
            Table of the blocks taken in, their sizes, and mean squares of third differences of all their channels
            (blocks, channels); None of blocks of less than two samples, which are not taken in together with others.
        """
        short = [size < 2 for size in sizes]
        sizes = sizes[: (*short, not short[0]).index(not short[0])]
        table = table[: sum(sizes) + 2]
        if short[0]:
            return table, sizes, None
        window, values, step = window_of(sizes), table[:, 1:], float(table[1, 0] - table[0, 0])
        squares, before = mean_third_differences_squared(values, window), []
        for square in squares:
            before.append(self._usual)
            self._learn(square)
        for b in np.flatnonzero(self._conspicuous(values, window, before)):
            part = slice(window.edges[b], window.edges[b + 1] + 2)
            cleaned, wild = self._cleaned(values[part], before[b], step, joints)
            if not wild.any():
                continue
            self._usual, self._blocks = before[b], self._blocks - len(sizes) + int(b)
            if b:
                return table[: window.edges[b] + 2], sizes[:b], squares[:b]
            self.replaced += int(wild[1:-1].sum())  # the others belong to other blocks
            square = mean_third_differences_squared(cleaned, window_of(sizes[:1]))
            self._learn(square[0])
            return np.hstack([table[part, :1], cleaned]), sizes[:1], square
        return table, sizes, squares

    def _learn(self, square: Array) -> None:
        """Updates the usual noise by a block's mean squares of third differences."""
        self._blocks += 1
        step = 1.0 / min(self._blocks, self._settings.memory)
        self._usual = square + 1e-12 if self._usual is None else self._usual + step * (square + 1e-12 - self._usual)

    def _conspicuous(self, values: Array, window: Window, before: Sequence[Array | None]) -> Bools:
        """Blocks (B,) in which a value deviates by as much as a spike, given the usual noise before each."""
        first, last, learnt = window.edges[:-1], window.edges[1:] - 1, self._blocks - len(before)
        steps = values[1:] - values[:-1]
        away = np.maximum.reduceat(_peaks(steps), first, axis=0)
        turns = 0.5 * np.abs(steps[1:] - steps[:-1])
        away = np.maximum(away, np.maximum(turns[first], turns[last]))
        usual = np.array([np.full(values.shape[1], np.inf) if each is None else each for each in before])
        usual[: max(self._settings.learnt - learnt, 0)] = np.inf
        return np.asarray((away > self._settings.wild * np.sqrt(usual)).any(axis=1))

    def _cleaned(self, values: Array, usual: Array | None, step: float, joints: int) -> tuple[Array, Bools]:
        """A block's values (n + 2, channels) without spikes, and which samples had any."""
        assert usual is not None
        steps, deviation = values[1:] - values[:-1], np.empty_like(values)
        deviation[1:-1] = _peaks(steps)
        deviation[0], deviation[-1] = 0.5 * np.abs(steps[0] - steps[1]), 0.5 * np.abs(steps[-1] - steps[-2])
        noise = np.sqrt(usual)
        wild = deviation > self._settings.wild * noise
        impossible = (deviation[:, :joints] > self._settings.fastest * step).any(axis=1, keepdims=True)
        wild &= _alone(deviation > self._settings.restless * noise) | impossible
        expected = np.empty_like(values)
        expected[1:-1] = 0.5 * (values[:-2] + values[2:])
        expected[0], expected[-1] = 2.0 * values[1] - values[2], 2.0 * values[-2] - values[-3]
        return np.where(wild, expected, values), np.asarray(wild.any(axis=1))


def _peaks(steps: Array) -> Array:
    """|x - median of three|, from steps between successive values: the distance to the nearer neighbour where it is a
    peak, else zero.
    """
    away = np.abs(steps)
    return np.where(steps[:-1] * steps[1:] < 0.0, np.minimum(away[:-1], away[1:]), 0.0)


def _alone(restless: Bools) -> Bools:
    """True where no other channel (samples, channels) is restless in the same sample, the one before or the one
    after.
    """
    around = restless.astype(int)
    around[1:] += restless[:-1]
    around[:-1] += restless[1:]
    return np.asarray(around.sum(axis=1, keepdims=True) == around)
