"""Finds changes of the load: averages over the last blocks against all that was known before.

Over the last n blocks, mass and first moment differ from what was known before by δ = N⁻¹ Σ Aᵀ W (b - A θ̂ - C p̂). How
much δ varies while nothing changes is taken from the log: its mean square over the past, for each n, scaled by how
much more the model's errors move an average over these blocks than they usually did (the robot sets out, turns,
stops). A change is reported when δ exceeds both the least change asked for and so many standard deviations, block after
block for a while. A push that lasts is a change too: nothing tells it from a load until it ends.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from itertools import islice
from typing import NamedTuple

import numpy as np

from stadera.trunk.considered import Errors
from stadera.trunk.segment import Segment, WeightedRows
from stadera.trunk.settings import ChangeSettings
from stadera.types import Array

_PHASES = 2.0  # times the mean variance by errors of the model that some phases of a step have
_NOTHING = 0.002**2  # variance of an average by errors of the model, up to which they count as none
_PRIOR_BLOCKS = 10.0  # that the prior of an average's spread is worth
_LEARNT = 40  # averages seen before they can report a change


@dataclass(frozen=True)
class Jump:
    """A change that was found.

    Attributes:
        blocks: how many blocks ago it happened.
        reported: whether it exceeds the least change; a smaller one only makes the estimate begin anew.
    """

    blocks: int
    reported: bool


class Deviation(NamedTuple):
    """An average over the last blocks, in units of `scale`.

    Attributes:
        size: δ (4,). by_errors: (4,) variance by errors of the model.
        own, before: (4,) variances by rows of unit noise, of the average and of what was known before.
    """

    size: Array
    by_errors: Array
    own: Array
    before: Array


class _Largest(NamedTuple):
    """The largest deviation: of how many blocks, how many standard deviations, whether to be reported, and δ."""

    blocks: int
    ratio: float
    reported: bool
    size: Array


class _Spread:
    """Mean square of an average's deviation while nothing changes, and of what model errors explain of it."""

    def __init__(self, prior: float, blocks: float) -> None:
        self._square, self._usual, self._weight = np.full(4, prior**2), np.zeros(4), blocks
        self._least = blocks
        self.seen = 0.0

    def learn(self, deviation: Array, expected: Array, memory: float) -> None:
        limited = np.minimum(deviation**2, 9.0 * self._square)
        self._weight = min(self._weight + 1.0, memory)
        self.seen += 1.0
        self._square = self._square + (limited - self._square) / self._weight
        self._usual = self._usual + (expected - self._usual) / min(self.seen, memory)

    def variance(self, expected: Array) -> Array:
        if self.seen == 0.0:
            return self._square
        return self._square * np.maximum((expected + _NOTHING) / (_PHASES * self._usual + _NOTHING), 1.0)


class ChangeDetector:
    """Looks at each block as it comes.

    Args:
        settings: when a change counts.
        scale: (4,) what mass and first moments are measured in: the robot's mass, and that times the leg's length.
        block: length of a block [s].

    Attributes:
        suspected: (4,) [kg, kg·m], by how much mass and first moment of the last blocks differ where that is likely a
            change, but not certain yet; else zero.
    """

    def __init__(self, settings: ChangeSettings, scale: Array, block: float) -> None:
        self.settings, self._scale, self._block = settings, scale, block
        self._short = tuple(n for n in settings.windows if n <= settings.pending)
        self._long = tuple(n for n in settings.windows if n > settings.pending)
        self._spreads = {n: _Spread(settings.prior, _PRIOR_BLOCKS) for n in settings.windows}
        self._waiting: deque[dict[int, Deviation]] = deque()
        self._persists = self._paused = 0
        self.suspected = np.zeros(4)

    def restart(self) -> None:
        """The load has changed: what was seen since belongs to both loads."""
        self._waiting.clear()
        self._persists = 0

    def look(
        self,
        recent: deque[WeightedRows],
        before: Segment,
        long_before: Segment,
        current: Segment,
        errors: Errors,
        scatter: float,
        held: bool,
    ) -> Jump | None:
        """A jump, once the last block makes it certain.

        Args:
            recent: the last blocks, not yet in `before`.
            before, long_before: what was known before the last `pending` of them, and before twice as many.
            current: what is known with all of them.
            errors: mean and standard deviations of the model's errors.
            scatter: κ, of sums of rows.
            held: report nothing, for the model does not fit.
        """
        deviations = self._since(before, recent, errors, self._short)
        deviations |= self._since(long_before, recent, errors, self._long)
        best = self._largest(deviations, scatter)
        likely = best.ratio > self.settings.suspected
        self.suspected = best.size * self._scale * likely
        self._paused = (self._paused + 1) * likely
        if self._paused == 0 or self._paused > 2 * self.settings.pending:
            self._learn(self._deviations(recent, current, errors, self.settings.windows))
        self._persists = (self._persists + 1) * (best.ratio > self.settings.deviations and not held)
        return Jump(best.blocks, best.reported) if self._persists >= self.settings.confirmed else None

    def _largest(self, deviations: dict[int, Deviation], scatter: float) -> _Largest:
        """The deviation of most standard deviations, of averages whose spread is known."""
        largest = _Largest(0, 0.0, False, np.zeros(4))
        for n, deviation in deviations.items():
            if self._spreads[n].seen >= _LEARNT:
                ratio, reported = self._ratio(n, deviation, scatter)
                if ratio > largest.ratio:
                    largest = _Largest(n, ratio, reported, deviation.size)
        return largest

    def _since(
        self, segment: Segment, recent: deque[WeightedRows], errors: Errors, windows: tuple[int, ...]
    ) -> dict[int, Deviation]:
        """Deviations from a segment, with its own variance; none while it is too short."""
        if segment.blocks * self._block < self.settings.history:
            return {}
        known = np.diag(segment.inverse @ segment.inverse.T)[:4] / self._scale**2
        found = self._deviations(recent, segment, errors, windows)
        return {n: deviation._replace(before=known) for n, deviation in found.items()}

    def _learn(self, deviations: dict[int, Deviation]) -> None:
        """What averages do while nothing changes, from deviations that are old enough to be sure of that."""
        self._waiting.append(deviations)
        while len(self._waiting) > self.settings.delay:
            for n, old in self._waiting.popleft().items():
                self._spreads[n].learn(old.size, old.by_errors, self.settings.memory / self._block)

    def _deviations(
        self, recent: deque[WeightedRows], before: Segment, errors: Errors, windows: tuple[int, ...]
    ) -> dict[int, Deviation]:
        """For each window that is full."""
        out, mean, K = {}, before.mean(errors.mean), before.sensitivity
        longest = [n for n in windows if n <= len(recent)]
        if not longest:
            return {}
        moments = [rows.moments for rows in islice(reversed(recent), max(longest))]
        total, count = np.zeros_like(moments[0]), 0
        for n in longest:
            for one in moments[count:n]:
                total = total + one
            count = n
            # what these blocks do not show at all is taken to be unchanged, to about the robot's own mass
            inverse = np.linalg.inv(total[:, :4] + np.diag(1.0 / self._scale**2))
            right = total[:, 10] - total[:, :10] @ mean - total[:, 11:] @ errors.mean
            by_errors = inverse @ (total[:, 11:] - total[:, :10] @ K)
            deviation = inverse @ right / self._scale
            expected = ((by_errors * errors.std) ** 2).sum(axis=1) / self._scale**2
            out[n] = Deviation(deviation, expected, np.diag(inverse) / self._scale**2, np.zeros(4))
        return out

    def _ratio(self, n: int, found: Deviation, scatter: float) -> tuple[float, bool]:
        """How many standard deviations, 0 where the change is too small; and whether it is to be reported."""
        spread = np.maximum(self._spreads[n].variance(found.by_errors), scatter * found.own)
        size = np.abs(found.size) / np.sqrt(spread + scatter * found.before)
        large = np.abs(found.size) > self.settings.least_change
        if large.any():
            return float(size[large].max()), True
        # a smaller one, over long averages alone, is adopted without a report
        return (float(size.max()), False) if n > self.settings.pending // 2 else (0.0, False)
