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
reported when it exceeds the least change and a number of standard deviations several times in succession. A sustained
push is reported as a change too: until it ends it cannot be distinguished from a load.
"""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

import numpy as np

from stadera.trunk.history import History
from stadera.trunk.joint_errors import Errors
from stadera.trunk.placed import Told
from stadera.trunk.segment import Segment
from stadera.trunk.settings import ChangeSettings
from stadera.types import Array


class Jump(NamedTuple):
    """A detected change.

    Attributes:
        blocks: the most likely number of blocks since it happened.
        reported: True if it exceeds the least change; a smaller one only restarts the estimate.
    """

    blocks: int
    reported: bool


class LoadDifference(NamedTuple):
    """Of the trunk over the latest blocks and before them.

    Attributes:
        before: the estimate before them. size: (10,), δ. std: (4,), of its mass and first moments.
    """

    before: Segment
    size: Array
    std: Array

    @property
    def ratios(self) -> Array:
        """(4,), of mass and first moments to their standard deviations."""
        return np.asarray(np.abs(self.size[:4]) / self.std)


class ChangeDetector:
    """Detects changes of the load, block by block.

    Args:
        settings: limits for a change.
        scale: (4,) units of mass and first moments: the robot's mass, and that times the leg's length.
        wide: (10,), standard deviations of a change before any row.
    """

    def __init__(self, settings: ChangeSettings, scale: Array, wide: Array) -> None:
        self.settings, self._scale, self._wide = settings, scale, wide
        self._windows = settings.windows
        self._products: deque[Array] = deque(maxlen=settings.windows[-1])  # Aᵀ W of all columns, by block
        self._square = np.ones((len(settings.windows), 4))  # mean square of ratios under a constant load
        self._count = np.full(len(settings.windows), settings.trusted)  # of independent ones
        self._waiting: deque[dict[int, Array]] = deque()  # ratios that may be those of a change
        self._seen = self._persists = 0
        self._moved = False

    def restart(self, kept: int) -> None:
        """Restarts after a change of the load: only the last `kept` blocks belong to the new one."""
        products = list(self._products)[-kept:] if kept else []
        self._products = deque(products, maxlen=self._products.maxlen)
        self._persists = 0
        self._waiting.clear()

    def dismiss(self) -> None:
        """Forgets a change that was about to be reported, which another place of the load explains."""
        self._persists = 0

    def look(self, history: History, errors: Errors, held: bool) -> Jump | None:
        """Returns a change when the last block makes it certain, else None.

        Args:
            history: all blocks, the last one included.
            errors: mean and covariance of the model's errors.
            held: suppress reports, because the model does not fit.
        """
        rows, settings = history.recent[-1], self.settings
        self._products.append(rows.weight * rows.columns[:, :10].T @ rows.columns)
        self._seen += 1
        self._moved = self._moved or rows.sliding >= settings.sliding
        if self._seen % settings.every:
            return None
        found = self._differences(history, errors)
        best, ratio = 0, 0.0
        for k, each in found.items():
            ratios = each.ratios / np.sqrt(self._square[k])
            if not self._large(each).any() and 3 * self._windows[k] < settings.pending:
                continue  # small changes count in long averages only
            if ratios.max() > ratio:
                best, ratio = k, float(ratios.max())
        if not held:
            self._learn({k: each.ratios for k, each in found.items()})
        self._persists = (self._persists + 1) * (ratio > settings.deviations and not held)
        if self._persists < settings.confirmed:
            return None
        change = found[best]
        return Jump(self._placed(change, self._windows[best], history, errors), bool(self._large(change).any()))

    def returned(self, before: Segment, since: Segment, history: History, errors: Errors) -> bool:
        """True if the load is again what it was before a change: the latest blocks agree with the estimate before, and
        not with that `since` the change. It was a push, or a foot that was caught.
        """
        settings, n = self.settings, self.settings.back
        if len(self._products) < n:
            return False
        usual, total = np.sqrt(self._square[self._windows.index(n)]), self._sums([n])[0]

        def ratio(segment: Segment) -> float:
            return float((self._difference(segment, total, history.noise, errors).ratios / usual).max())

        return ratio(before) < settings.agreeing and ratio(since) > settings.deviations

    def _large(self, change: LoadDifference) -> Array:
        """Which of mass and first moments (4,) change by more than the least change that is reported."""
        return np.asarray(np.abs(change.size[:4]) > self.settings.least_change * self._scale)

    def _sums(self, windows: list[int]) -> list[Array]:
        """Sums of the products of the last blocks, for each window."""
        latest, out = np.array(self._products)[::-1], list[Array]()
        for begin, end in zip([0, *windows], windows, strict=False):
            part = latest[begin:end].sum(axis=0)
            out.append(out[-1] + part if out else part)
        return out

    def _differences(self, history: History, errors: Errors) -> dict[int, LoadDifference]:
        """Those over all windows with enough blocks before them, by the window's number."""
        before = {}
        for k, n in enumerate(self._windows):
            known = history.before_last(n) if n <= len(self._products) else None
            if known is not None and known.weight >= self.settings.history:
                before[k] = known
        sums = self._sums([self._windows[k] for k in before])
        return {
            k: self._difference(known, total, history.noise, errors)
            for (k, known), total in zip(before.items(), sums, strict=True)
        }

    def _difference(self, before: Segment, total: Array, noise: float, errors: Errors) -> LoadDifference:
        """Over blocks of which the products' sum is known; their rows scatter by `noise` times their unit."""
        scaled = self._wide[:, None] * total[:, :10] * self._wide  # rounding hides parameters that no row shows
        inverse = self._wide[:, None] * np.linalg.inv(scaled + np.eye(10)) * self._wide
        size = inverse @ (total @ before.combination(errors.mean))
        known = before.whole
        known = Told(known.inverse, known.solution, np.empty((10, 0)))  # how it moves is learnt from ratios here
        sensitivity = known.sensitivity + inverse @ before.by_errors(total)
        root = np.sqrt(noise) * np.linalg.cholesky(0.5 * (inverse + inverse.T))
        since = Told(root, np.hstack([size[:, None], sensitivity]), np.empty((10, 0)))
        covariance = errors.difference_covariance(known, since, errors.alike(before) if self._moved else 1.0)
        return LoadDifference(before, size, np.sqrt(np.diagonal(covariance)[:4]))

    def _learn(self, ratios: dict[int, Array]) -> None:
        """Updates the mean squares of ratios, after `pending`: the latest may be those of a change."""
        settings = self.settings
        self._waiting.append(ratios)
        if len(self._waiting) * settings.every <= settings.pending:
            return
        for k, each in self._waiting.popleft().items():
            share = min(settings.every / self._windows[k], 1.0)  # windows overlap
            self._count[k] += share
            self._square[k] += (each**2 - self._square[k]) * share / self._count[k]

    def _placed(self, change: LoadDifference, n: int, history: History, errors: Errors) -> int:
        """Most likely number of blocks since the change: those since then fit the estimate after it better than the one
        before.
        """
        rows = list(history.recent)[-(n + self.settings.pending) :]
        columns = np.array([each.columns for each in rows])
        before = columns @ change.before.combination(errors.mean)
        after = before - columns[:, :, :10] @ change.size
        better = (before**2 - after**2).sum(axis=1)
        usual = np.median(np.abs(better))
        return int(np.argmax(np.cumsum(np.clip(better, -2.0 * usual, 2.0 * usual)[::-1]))) + 1
