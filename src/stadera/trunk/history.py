"""Sums of the rows by load: the present load's, those of loads before it, and those since the tare."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import replace
from math import exp
from typing import NamedTuple

import numpy as np

from stadera.robot.model import Robot
from stadera.trunk.block_rows import BlockRows, WeightedRows, Weighting, noise_of_limbs
from stadera.trunk.error_model import ErrorLayout
from stadera.trunk.placed import Blocks, Held
from stadera.trunk.segment import RowSums, Segment
from stadera.trunk.settings import OutlierSettings, TrunkSettings
from stadera.trunk.window import half_window
from stadera.types import Array


class RobustWeights:
    """Weights of blocks by their residuals, as if these had Student's t distribution with ν degrees of freedom.

    A block of n rows r, 6 of the trunk or one of each joint of the limbs, whose usual mean square is u counts for

        w = (ν + n) / (ν + rᵀ S⁻¹ r),      S = u,      u = Σ w |r|² / (n Σ w)

    as of the EM algorithm (Lange, Little and Taylor, Robust statistical modeling using the t distribution, J. Am. Stat.
    Assoc. 84 (1989) 881). u is averaged over the latest blocks. Without them impacts and slips decide: masses of one
    robot's walks differ twice as much.

    Of a robot that does not walk, S has besides what the estimate, and errors of covariance Σ, may do to r:

        S = u (1 + B Bᵀ) + D Σ Dᵀ,      B = A R⁻¹,      D = ∂r/∂p

    A robot that squats shows its friction when it turns round, as residuals that are far from usual until then: taken
    for outliers they hide friction. Payloads of 29 simulated squats, sways and errands with real errors are off by
    3.7 % of the robot (rms), with bars of 1.5 % (median), and with this by 1.8 %, with bars of 1.2 %. What even S does
    not explain counts by u alone. In a walk it is impacts that are unusual.

    Args:
        least: least of u [1]; None for `OutlierSettings.least_usual`. each: each row has a usual square of its own, and
            S is diagonal; else all n have one.

    Attributes:
        usual: u (n,), or one for all [1], in the rows' unit; NaN before any. count: number of blocks that it is an
            average of.
    """

    def __init__(self, settings: OutlierSettings, least: float | None = None, each: bool = False) -> None:
        self._settings, self._each = settings, each
        self._least = settings.least_usual if least is None else least
        self.usual, self.count = np.array(np.nan), 0.0

    @property
    def noise(self) -> Array:
        """u, or the least; one before any."""
        return np.maximum(self._least, self.usual) if self.count else np.array(1.0)

    def weight(self, columns: Array, known: Segment, errors: Array, covariance: Array | None = None) -> float:
        """w of a block of rows (n, ...), given the estimate and model errors p̂ (errors,), with their `covariance` Σ if
        that is in S; one before there are enough rows.
        """
        settings = self._settings
        if known.blocks < (settings.afresh if self.count else settings.enough):
            return 1.0
        residual, n = columns @ known.combination(errors), len(columns)
        square = residual * residual if self._each else np.asarray(residual @ residual / n)
        if not self.count:
            self.usual = square
        noise = np.maximum(self.usual, self._least)
        far = n * float((square / noise).mean())
        if covariance is not None:
            D, B = known.by_errors(columns), known.by_noise(columns)
            S = noise * (np.eye(n) + B @ B.T) + D @ covariance @ D.T
            uncertain = float(residual @ np.linalg.solve(S, residual))
            far = uncertain if uncertain < settings.explained * n else far
        weight = (settings.freedom + n) / (settings.freedom + far)
        self.count = min(self.count + 1.0, settings.remembered)
        self.usual = self.usual + weight * (square - self.usual) / self.count
        return weight


class Known(NamedTuple):
    """What was known before a change of the load, to return to if it was a push: the load's estimate, the loads before
    it, and the estimate by the rows since the tare alone.
    """

    before: Segment
    finished: tuple[Segment, ...]
    loaded: Segment | None


def wide_prior(robot: Robot) -> Array:
    """Standard deviations (10,) of trunk parameters before any row."""
    le = robot.leg_length
    return np.asarray(robot.mass * np.array([1.0, *[0.5 * le] * 3, *[0.5 * le**2] * 6]))


class History:
    """Sums of all rows so far.

    The latest blocks are kept one by one, with the estimate before each of them, since a change is detected some time
    after it happened: twice `ChangeSettings.pending` blocks.

    Args:
        robot: the model. prior: (10,), of the trunk. layout: places of the model errors.
        places: number of those where a load may be, besides the trunk.
        friction: (joints,) [N·m], see `ModelFit.friction`. static: (joints,) [N·m], standard deviation of the friction
            that may hold a joint.

    Attributes:
        at: where the present load is. before: the trunk without it; None before any load and without a tare.
        blocks: number of blocks so far.
        recent: the latest blocks of the present load.
        finished: the last four loads before the present one.
        tare: the trunk at the last tare; None without one.
    """

    def __init__(
        self,
        robot: Robot,
        prior: Array,
        layout: ErrorLayout,
        settings: TrunkSettings,
        places: int = 0,
        friction: Array | None = None,
        static: Array | None = None,
    ) -> None:
        self._settings, self._layout, self._places = settings, layout, places
        self.at: Blocks = (0,)
        self.before: Segment | None = None
        self._divided = False  # a load began since the tare
        self._wide = wide_prior(robot)
        self._weighting = Weighting.of(robot, layout, settings, friction, static)
        self.blocks = 0
        self.recent: deque[WeightedRows] = deque()
        self._known = deque([Segment.prior(prior, self._wide, layout, places)])  # before each of `recent`, and with all
        self.finished: tuple[Segment, ...] = ()
        self._earlier: RowSums | None = None  # the sum of `finished`
        self.tare: Segment | None = None
        self._loaded: deque[Segment | None] = deque([None])  # likewise, by the rows since the tare alone
        self._unused = 0  # next blocks that still contain samples before the tare
        self._robust, self._since_tare = RobustWeights(settings.outliers), RobustWeights(settings.outliers)
        least = (settings.model.offset / noise_of_limbs(settings.model)) ** 2
        self._robust_limbs = RobustWeights(settings.outliers, least, each=True)
        self._limbs: list[Array] = []

    @property
    def current(self) -> Segment:
        """The present estimate."""
        return self._known[-1]

    @property
    def loaded(self) -> Segment | None:
        """The trunk by the rows since the tare alone, until a change is detected; None without a tare."""
        return self._loaded[-1]

    @property
    def carried(self) -> Segment:
        """The same, or without a tare the present estimate."""
        return self.loaded or self.current

    @property
    def aged(self) -> Segment:
        """The estimate without the last `pending` blocks, in which a change may still be detected."""
        return self._known[self._pending]

    @property
    def _pending(self) -> int:
        """Place, among what was known, before the blocks in which a change may still be detected."""
        return max(len(self.recent) - self._settings.changes.pending, 0)

    def before_last(self, blocks: int) -> Segment | None:
        """The estimate without so many latest blocks; None if they are not all of the present load."""
        return self._known[-1 - blocks] if blocks < len(self._known) else None

    @property
    def noise(self) -> float:
        """Variance of the rows' residuals in their unit [1]; one before any."""
        return float(self._robust.noise)

    @property
    def oldest(self) -> Segment:
        """The estimate without all `recent` blocks."""
        return self._known[0]

    @property
    def wide_load(self) -> Array:
        """Standard deviations (10,) of a load before any row."""
        return self._settings.after_change * self._wide

    @property
    def since_load(self) -> Segment | None:
        """The rows since the tare, or since the last change of the load; None without either."""
        return self.loaded if self.loaded is not None else self.current if self._divided else None

    @property
    def total(self) -> RowSums:
        """Sums over all loads. Rows in which a change may still be detected do not count against the model. After a
        tare there may be another load, noticed or not: taken for one and the same, errors of the model would explain
        it.
        """
        enough = self._settings.outliers.enough
        if self.tare is not None and self.loaded is not None and self.loaded.blocks:
            since = self._loaded[self._pending]
            last = self.loaded if since is None or since.blocks < enough else since
            return self._sum((*self.finished, self.tare, last))
        last = self.aged if self.aged.blocks >= enough or self.finished else self.current
        return self._sum((last,)) if self._earlier is None else self._earlier + self._sum((last,))

    def add(self, made: BlockRows, errors: Array, covariance: Array | None = None) -> WeightedRows:
        """Adds a block, and returns its rows with their weight; `errors` are p̂, `covariance` theirs if there is one."""
        keep = exp(-made.elapsed / self._settings.memory)
        rows = self._with_limbs(self._weighting.weighted(made), errors)
        known, weight = self._with(self.current, rows, keep, self._robust, errors, covariance)
        rows = replace(rows, weight=weight)
        self._known.append(known)
        self.recent.append(rows)
        self.blocks += 1
        loaded = self.loaded
        if loaded is not None:
            self._unused -= 1
            if self._unused < 0:  # weighted by residuals from the present load: the estimate may be of the one before
                loaded, _ = self._with(loaded, rows, keep, self._since_tare, errors, covariance)
        self._loaded.append(loaded)
        if len(self.recent) > 2 * self._settings.changes.pending:
            self.recent.popleft()
            self._known.popleft()
            self._loaded.popleft()
        return rows

    def _with_limbs(self, rows: WeightedRows, errors: Array) -> WeightedRows:
        """The block with the limbs' rows averaged by a raised cosine over twice the blocks that share one error, in the
        unit of their residuals; every so many blocks one, the others with none. What is usual, and what is not, is
        defined by those before the tare: since then a load may be where none is assumed yet.

        An arm moves slowly: its accelerations in a single block are noise, in the columns of a load and, times the
        arm's inertia, in the target, which makes the load too light. In the mean they cancel, but for those at its
        ends, which have little weight here: with a plain mean over half the blocks loads in the hands of twelve
        simulated Talos that step are 0.8 % of the robot too light (median), with this one 0.1 %.
        """
        if rows.limbs is None:
            return rows
        self._limbs.append(rows.limbs)
        count = round(self._settings.swing.repeated)
        if len(self._limbs) < 2 * count:
            return replace(rows, limbs=None)
        rising = half_window(count)
        mean = np.tensordot(np.concatenate([rising, rising[::-1]]), np.array(self._limbs), 1)
        del self._limbs[:count]
        unit = np.sqrt(self._robust_limbs.noise)
        weight = self._robust_limbs.weight(mean, self.current, errors) if self.loaded is None else 1.0
        return replace(rows, limbs=mean / np.reshape(unit, (-1, 1)), limb_weight=count * weight)

    def set_tare(self, errors: Array) -> None:
        """Makes the present trunk the tare. Later rows are summed separately too."""
        self.tare = self.before = self.current.with_load(None)
        self._divided = False
        self._unused = self._settings.changes.spoilt
        self._since_tare = RobustWeights(self._settings.outliers)
        self._limbs.clear()
        self._loaded[-1] = self._widened(self.current, errors)

    def begin_load(self, blocks: int, errors: Array) -> Known:
        """Begins a load that came so many blocks ago, with the rows since, and returns what was known before."""
        recent, spoilt = list(self.recent), self._settings.changes.spoilt
        blocks = min(blocks, len(recent))
        last = max(len(recent) - blocks - spoilt, 0)
        before = self._known[last]
        known = Known(before, self.finished, self._loaded[last])
        if self.before is None:
            self.before = before
        self._divided = True
        self._set((*self.finished[-3:], before))
        self._begin(self._widened(before, errors), (), None)
        for alone in self._of_one_load(recent[len(recent) - blocks + spoilt :]):
            known_since, weight = self._with(self.current, alone)  # weights were by residuals from the earlier load
            self.recent.append(replace(alone, weight=weight))
            self._known.append(known_since)
            self._loaded.append(None)
        return known

    def return_to(self, known: Known) -> None:
        """Continues an earlier load with the latest `ChangeSettings.back` blocks."""
        rows = self._of_one_load(list(self.recent)[-self._settings.changes.back :])
        self._set(known.finished)
        self._begin(known.before, rows, known.loaded)

    def _of_one_load(self, rows: Sequence[WeightedRows]) -> list[WeightedRows]:
        """The latest blocks, without means of limbs' rows that contain earlier ones; nor will the next mean."""
        self._limbs = self._limbs[max(len(self._limbs) - len(rows), 0) :]
        first = 2 * round(self._settings.swing.repeated) - 1
        return [row if k >= first else replace(row, limbs=None) for k, row in enumerate(rows)]

    def _begin(self, segment: Segment, rows: Sequence[WeightedRows], loaded: Segment | None) -> None:
        self._known, self.recent, self._loaded = deque([segment]), deque(rows), deque([loaded])
        for row in rows:
            self._known.append(self.current.add(row, louder=self.noise))
            if loaded is not None:
                loaded = loaded.add(row, louder=self.noise)
            self._loaded.append(loaded)

    def _with(
        self,
        known: Segment,
        rows: WeightedRows,
        keep: float = 1.0,
        robust: RobustWeights | None = None,
        errors: Array | None = None,
        covariance: Array | None = None,
    ) -> tuple[Segment, float]:
        """A segment with one more block, and the weight that this has there: by its residuals, and by its joints'
        sliding, see `OutlierSettings`, unless friction is in its share already (`Segment.felt`).
        """
        settings, felt = self._settings.outliers, known.felt(rows)
        weight = 1.0
        if robust is not None and errors is not None:
            walks = rows.stepping or known.steps
            weight = robust.weight(felt.columns, known, errors, None if walks else covariance)
        if known.moved and rows.sliding < settings.sliding:
            weight *= min(settings.held / felt.share, 1.0)
        elif known.blocks and not known.moved and known.moves(rows):
            keep *= settings.held  # what a robot showed that has only stood, once it moves
        return known.add(replace(felt, weight=weight), keep, louder=self.noise), weight

    def _set(self, finished: tuple[Segment, ...]) -> None:
        self.finished = finished
        self._earlier = self._sum(finished) if finished else None

    def _sum(self, segments: Sequence[Segment]) -> RowSums:
        swing = self._settings.swing
        return RowSums.of(segments, swing.repeated, swing.returning, swing.strides)

    def _widened(self, known: Segment, errors: Array) -> Segment:
        """A prior for the trunk under another load."""
        return Segment.prior(known.mean(errors), self.wide_load, self._layout, self._places, self._held)

    @property
    def _held(self) -> Held | None:
        return None if self.at == (0,) or self.before is None else Held(self.at, self.before)

    def move(self, at: Blocks) -> None:
        """Takes the present load to be elsewhere."""
        self.at = at
        if self._divided:
            self._known = deque(segment.with_load(self._held) for segment in self._known)
        self._loaded = deque(None if each is None else each.with_load(self._held) for each in self._loaded)
