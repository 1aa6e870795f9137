"""Detects changes of the load: the latest blocks against the estimate before them, by the bars of a payload.

The estimate before the last n blocks is θ̂, which errors p move by -K p. With W the weights of the last n blocks and r
their residuals with respect to it, r = b - A θ̂ - C p̂, the trunk since then differs by

    δ = N⁻¹ Aᵀ W r,      N = Aᵀ W A + P₀⁻¹,      ∂δ/∂p = -N⁻¹ Aᵀ W (C - A K)

where P₀ is wide. The covariance of δ is that of a payload since a tare: the rows' scatter, and what uncertain errors do
to the difference (`Errors.difference_covariance`). So a change is what the bars say is one: δ over its standard
deviation, the largest of mass and first moments, for a number of n. A robot that has only stood has the static friction
that it had, unless its load changes, so there it cancels.

What a robot does and the model does not know makes these ratios larger, differently for different n. Their mean square
under a constant load is taken from the log; one, as honest bars have it, counts as some ratios seen before. A change is
reported when it exceeds the least change and a number of standard deviations several times in succession, which grows
with the residuals' size where that exceeds what the bars expect. A sustained push is reported as a change too: until it
ends it cannot be distinguished from a load.

A hand's load that is lost in the bars of the trunk's rows shows in its arm's. There a change is what moves the residual
of one joint, in three means in succession and to one side, by so many standard deviations of the usual residual and of
what uncertain errors do: friction of a joint that begins to move is none.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from math import isfinite, sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stadera.trunk.history import History
from stadera.trunk.joint_errors import Errors
from stadera.trunk.placed import Solved
from stadera.trunk.segment import Segment
from stadera.trunk.settings import ChangeSettings
from stadera.types import Array, Bools

_ANEW = 1000  # blocks after which sums begin at zero again: they are differences of long ones

Ints = NDArray[np.int64]


class Jump(NamedTuple):
    """A detected change.

    Attributes:
        blocks: the most likely number of blocks since it happened.
        reported: True if it exceeds the least change; a smaller one only restarts the estimate.
        felt: True if a limb's joints show it.
    """

    blocks: int
    reported: bool
    felt: bool = False


class LoadDifferences(NamedTuple):
    """Of the trunk over the latest blocks and before them, for W numbers of blocks.

    Attributes:
        before: W estimates before them. size: (W, 10), δ. std: (W, 4), of its mass and first moments.
    """

    before: Sequence[Segment]
    size: Array
    std: Array

    @property
    def ratios(self) -> Array:
        """(W, 4), of mass and first moments to their standard deviations."""
        return np.asarray(np.abs(self.size[:, :4]) / self.std)


class ChangeDetector:
    """Detects changes of the load, block by block.

    Args:
        settings: limits for a change.
        scale: (4,) units of mass and first moments: the robot's mass, and that times the leg's length.
        wide: (10,), standard deviations of a change before any row.
    """

    def __init__(self, settings: ChangeSettings, scale: Array, wide: Array) -> None:
        self.settings, self._scale, self._wide = settings, scale, wide
        self._windows = np.array(settings.windows)
        self._sums: deque[Array | float] = deque([0.0], settings.windows[-1] + 1)  # of Aᵀ W times all columns, by block
        self._square = np.ones((len(settings.windows), len(scale)))  # mean square of ratios under a constant load
        self._count = np.full(len(settings.windows), settings.trusted)  # of independent ones
        self._waiting: deque[tuple[Ints, Array]] = deque()  # windows, and ratios that may be those of a change
        self._seen = self._persists = 0
        self._moved = False

    def restart(self, kept: int) -> None:
        """Restarts after a change of the load: only the last `kept` blocks belong to the new one."""
        self._sums = deque(list(self._sums)[-1 - kept :], self._sums.maxlen)
        self._persists = 0
        self._waiting.clear()

    def dismiss(self) -> None:
        """Forgets a change that was about to be reported, which another place of the load explains."""
        self._persists = 0

    def look(self, history: History, errors: Errors, misfit: float = 1.0) -> Jump | None:
        """Returns a change when the last block makes it certain, else None.

        Args:
            history: all blocks, the last one included.
            errors: mean and covariance of the model's errors.
            misfit: variance of the residuals over the expected one [1]; above 1 a change has to be larger in proportion
                to their size. inf: nothing is reported or learnt.
        """
        rows, settings = history.recent[-1], self.settings
        self._sums.append(self._sums[-1] + rows.weight * rows.columns[:, :10].T @ rows.columns)
        self._seen += 1
        if self._seen % _ANEW == 0:
            self._sums = deque([each - self._sums[0] for each in self._sums], self._sums.maxlen)
        self._moved = self._moved or rows.sliding >= settings.sliding
        if self._seen % settings.every:
            return None
        which, found = self._differences(history, errors)
        large, windows = self._large(found.size), self._windows[which]
        counts = large | (3 * windows >= settings.pending)  # small changes count in long averages only
        ratios = np.where(counts, (found.ratios / np.sqrt(self._square[which])).max(axis=1), 0.0)
        if isfinite(misfit):
            self._learn(which, found.ratios)
        least = settings.deviations * sqrt(max(misfit, 1.0))
        self._persists = (self._persists + 1) * bool((ratios > least).any())
        if self._persists < settings.confirmed:
            return None
        best = int(np.argmax(ratios))
        placed = self._placed(found.before[best], found.size[best], int(windows[best]), history, errors)
        return Jump(placed, bool(large[best]))

    def felt(self, history: History, errors: Errors) -> Jump | None:
        """A change that the limbs' rows show when the last block completes a mean, else None."""
        ends = [k for k, rows in enumerate(history.recent) if rows.limbs is not None][-self.settings.means :]
        last = len(history.recent)
        if len(ends) < self.settings.means or ends[-1] + 1 < last:
            return None
        step = ends[-1] - ends[-2]
        before = history.before_last(last - max(ends[0] + 1 - 2 * step, 0))  # a mean is of twice as many blocks
        if before is None or not self._enough(before):
            return None
        ratios = []
        for limbs in (history.recent[k].limbs for k in ends):
            assert limbs is not None
            D, B = before.by_errors(limbs), before.by_noise(limbs)
            variance = 1.0 + (B**2).sum(axis=1) + (D @ errors.covariance * D).sum(axis=1)
            ratios.append(limbs @ before.combination(errors.mean) / np.sqrt(variance))
        same = np.abs(np.sign(ratios).sum(axis=0)) == len(ends)
        if not (same & (np.abs(ratios).min(axis=0) > self.settings.deviations)).any():
            return None
        return Jump(last - 1 - ends[0], reported=True, felt=True)

    def returned(self, before: Segment, since: Segment, history: History, errors: Errors) -> bool:
        """True if the load is again what it was before a change: the latest blocks, `back` and the next window, agree
        with the estimate before, and not with that `since` the change. It was a push, or a foot that was caught.
        """
        settings = self.settings
        first = settings.windows.index(settings.back)
        windows = settings.windows[first : first + 2]  # friction may hide a load for a moment
        if len(self._sums) <= windows[-1]:
            return False
        usual, total = np.sqrt(self._square[first : first + 2]), self._over(windows)

        def ratios(segment: Segment) -> Array:
            found = self._difference([segment] * len(windows), total, history.noise, errors)
            return np.asarray((found.ratios / usual).max(axis=1))

        return bool(ratios(before).max() < settings.agreeing and ratios(since).min() > settings.deviations)

    def _large(self, size: Array) -> Bools:
        """Whether mass or first moments (..., 10) change by more than the least change that is reported."""
        return np.asarray((np.abs(size[..., :4]) > self.settings.least_change * self._scale).any(axis=-1))

    def _over(self, windows: Sequence[int]) -> Array:
        """Sums of the products of the last blocks (W, 10, ...), for each window."""
        return np.array([self._sums[-1] - self._sums[-1 - n] for n in windows])

    def _differences(self, history: History, errors: Errors) -> tuple[Ints, LoadDifferences]:
        """Those over all windows with enough blocks before them, and the windows' numbers."""
        known = [history.before_last(n) if n < len(self._sums) else None for n in self.settings.windows]
        before = {k: each for k, each in enumerate(known) if each and self._enough(each)}
        which, over = np.array([*before], dtype=np.int64), self._over([self.settings.windows[k] for k in before])
        return which, self._difference([*before.values()], over, history.noise, errors)

    def _enough(self, before: Segment) -> bool:
        """Whether an estimate has the blocks that are needed for a change to be told from it, whatever they weigh."""
        return before.blocks >= (self.settings.history_walking if before.steps else self.settings.history)

    def _difference(self, before: Sequence[Segment], over: Array, noise: float, errors: Errors) -> LoadDifferences:
        """Over blocks of which the products' sums (W, 10, ...) are known; their rows scatter by `noise` times their
        unit. The segments `before` have loads in the same places.
        """
        if not before:
            return LoadDifferences(before, np.zeros((0, len(self._wide))), self._square[:0])
        wide = self._wide[:, None]
        scaled = wide * over[:, :, :10] * self._wide  # rounding hides parameters that no row shows
        inverse = wide * np.linalg.inv(scaled + np.eye(10)) * self._wide
        rows, few = inverse @ over, slice(0, 4)
        size = np.array([row @ each.combination(errors.mean) for each, row in zip(before, rows, strict=True)])
        # of mass and first moments alone; how the estimate before moves is learnt from ratios here
        known = Solved.stack([each.whole for each in before], few)
        moved = np.array([each.by_errors(row) for each, row in zip(before, rows[:, few], strict=True)])
        sensitivity = known.sensitivity + moved
        own = inverse[:, few, few]
        root = np.sqrt(noise) * np.linalg.cholesky(0.5 * (own + own.mT))
        since = Solved(root, np.concatenate([size[:, few, None], sensitivity], axis=2), known.before)
        alike = np.array([errors.alike(each) if self._moved else 1.0 for each in before])
        covariance = errors.difference_covariance(known, since, alike[:, None, None])
        return LoadDifferences(before, size, np.sqrt(np.diagonal(covariance, axis1=1, axis2=2)))

    def _learn(self, which: Ints, ratios: Array) -> None:
        """Updates the mean squares of ratios, after `pending`: the latest may be those of a change."""
        settings = self.settings
        self._waiting.append((which, ratios))
        if len(self._waiting) * settings.every <= settings.pending:
            return
        which, ratios = self._waiting.popleft()
        share = np.minimum(settings.every / self._windows[which], 1.0)  # windows overlap
        self._count[which] += share
        self._square[which] += (ratios**2 - self._square[which]) * (share / self._count[which])[:, None]

    def _placed(self, before: Segment, size: Array, n: int, history: History, errors: Errors) -> int:
        """Most likely number of blocks since the change: those since then fit the estimate after it better than the one
        before.
        """
        rows = list(history.recent)[-(n + self.settings.pending) :]
        columns = np.array([each.columns for each in rows])
        earlier = columns @ before.combination(errors.mean)
        after = earlier - columns[:, :, :10] @ size
        better = (earlier**2 - after**2).sum(axis=1)
        usual = np.median(np.abs(better))
        return int(np.argmax(np.cumsum(np.clip(better, -2.0 * usual, 2.0 * usual)[::-1]))) + 1
