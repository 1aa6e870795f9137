"""Weights the rows, and computes the trunk and its covariance from the summed rows with considered errors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from types import ModuleType

import numpy as np

from stadera.compiled import kernel
from stadera.constants import GRAVITY
from stadera.robot.model import Robot
from stadera.trunk.error_model import ERRORS, JOINTS, PLACES, SHOWN, STICKING, ErrorModel
from stadera.trunk.rows import BlockRows
from stadera.trunk.segment import Segment, WeightedRows, by_force
from stadera.trunk.swing import SwingJoints
from stadera.types import Array

_QUIETEST = 0.25  # squared residuals below those of 0.5 % of the weight do not sharpen the estimate further
_UNIT = 0.01  # of weight, and of weight times leg length: the unit of the rows


def unit_of_rows(robot_weight: float, length: float) -> Array:
    """Unit of the rows (6,): 1 % of the robot's weight [N], of moments that with the leg's length as lever [N·m].

    It is the same for all blocks. Weights that follow the noise of each block would be optimal if noise were the only
    error. On real robots they are worse: the apparent momentum from late torques, rotor inertia and friction cancels
    over whole steps, but only if all phases of a step have equal weight.
    """
    return np.asarray(_UNIT * robot_weight * np.array([1.0, 1.0, 1.0, length, length, length]))


def weighted(rows: BlockRows, unit: Array) -> WeightedRows:
    """Scales rows to their `unit_of_rows`."""
    return WeightedRows(rows.time, rows.columns / unit[:, None], float((rows.white / unit**2).sum()))


@dataclass(frozen=True, eq=False)
class RowSums:
    """Estimates rotor inertia, friction and torque lag of the joints from the trunk's own rows, for any trunk.

    With θ eliminated, the rows leave M (p - p̂) = v, M = Cᵀ Q C. Only the part k of p is updated. The rest (offsets,
    gains, geometry) could be mistaken for weight and is considered. With N = M_k / s, (k, all), and

        S = (P_kk⁻¹ + N_kk)⁻¹ = (1 + P_kk N_kk)⁻¹ P_kk,      G = S N

    the errors become

        e_k' = e_k - G e + n,      Σ' = F Σ Fᵀ + Cov n,      F = 1 - [G; 0],      Cov n = S N_kk S

    An error in one row persists through a swing or a stance, so s is the residual's variance times `repeated`.

    Attributes:
        remainder: see `Segment.remainder`, summed over segments. blocks: number of blocks.
        repeated: number of successive rows with the same error [1].
        white: Σ of the rows' white variance [1].
    """

    remainder: Array
    blocks: int
    repeated: float
    white: float = 0.0

    @classmethod
    def of(cls, segments: Sequence[Segment], repeated: float) -> RowSums:
        """Sums up segments of the same robot."""
        first, *others = segments
        total = cls(first.remainder, first.blocks, repeated, first.white)
        for segment in others:
            total = total.plus(segment)
        return total

    def plus(self, segment: Segment) -> RowSums:
        """With one more segment."""
        return RowSums(
            self.remainder + segment.remainder,
            self.blocks + segment.blocks,
            self.repeated,
            self.white + segment.white,
        )

    def update(self, mean: Array, known: Covariance) -> Covariance:
        """Updates p̂ (ERRORS,) in place, and returns the new Σ, given one with `Covariance.shown` of the prior."""
        if not self.blocks:
            return known
        along = self.remainder[1:, 0] - self.remainder[1:, 1:][:, JOINTS] @ mean[JOINTS]
        square = float(self.remainder[0, 0] - (self.remainder[1:, 0] + along) @ mean)
        loud = self.repeated * max(square / (6.0 * self.blocks), _QUIETEST)
        normal = self.remainder[1:, 1:][SHOWN] / loud
        found = _combined(known.joints[SHOWN, SHOWN], normal[:, SHOWN])
        mean[SHOWN] += found @ along[SHOWN] / loud
        moved = known.shown - found @ known.applied(normal)
        own = moved[:, SHOWN] + (found @ normal[:, SHOWN] - moved @ normal.T) @ found
        moved[:, SHOWN] = 0.5 * (own + own.T)
        return known.replaced(moved)


@dataclass(frozen=True, eq=False)
class Covariance:
    """Covariance Σ of the model errors, of which only those in `JOINTS`, those of static friction, and those in `SHOWN`
    with all others may be correlated.

    Attributes:
        joints: (JOINTS, JOINTS). sticking: (12, 12), of static friction. variance: (ERRORS,), the diagonal.
        shown: (SHOWN, ERRORS), the rows of those that loaded rows determine too.
    """

    joints: Array
    sticking: Array
    variance: Array
    shown: Array

    @classmethod
    def of(cls, model: ErrorModel, scale: float, joints: Array) -> Covariance:
        """Before any loaded row: the prior with its standard deviations times `scale`, and `joints`."""
        (sticking, variance), shown = model.scaled(scale), np.zeros((SHOWN.stop, ERRORS))
        variance[JOINTS], shown[:, JOINTS] = np.diagonal(joints), joints[SHOWN]
        return cls(joints, sticking, variance, shown)

    @cached_property
    def dense(self) -> Array:
        """Σ (ERRORS, ERRORS)."""
        out = np.diag(self.variance)
        out[JOINTS, JOINTS], out[STICKING, STICKING] = self.joints, self.sticking
        out[SHOWN], out[:, SHOWN] = self.shown, self.shown.T
        return out

    def applied(self, rows: Array) -> Array:
        """Products with Σ, of rows (n, ERRORS): a third of the operations of a dense product."""
        others, offsets = slice(SHOWN.stop, None), slice(SHOWN.stop, JOINTS.stop)
        out: Array = rows[:, SHOWN] @ self.shown
        out[:, SHOWN] += rows[:, others] @ self.shown[:, others].T
        variance = self.variance[others].copy()
        variance[: JOINTS.stop - SHOWN.stop] = 0.0
        variance[STICKING.start - SHOWN.stop : STICKING.stop - SHOWN.stop] = 0.0
        out[:, others] += rows[:, others] * variance
        out[:, offsets] += rows[:, offsets] @ self.joints[offsets, offsets]
        out[:, STICKING] += rows[:, STICKING] @ self.sticking
        return out

    def given(self, place: int) -> tuple[Covariance, Array]:
        """Σ of the others if one error, which is correlated only with those in `SHOWN`, were known; and what a unit of
        it moves all of them by, f (ERRORS,): Σ = Σ' + f fᵀ times its variance.
        """
        own, along, shown = self.variance[place], np.zeros(ERRORS), self.shown.copy()
        along[SHOWN], along[place] = shown[:, place] / own, 1.0
        shown[:, SHOWN] -= own * np.outer(along[SHOWN], along[SHOWN])
        shown[:, place] = 0.0
        others = self.replaced(shown)
        others.variance[place] = 0.0
        return others, along

    def explained(self, products: Array) -> tuple[float, float]:
        """tr D Σ and tr (D Σ)², with D but for its first row and column the products (1 + ERRORS, 1 + ERRORS) of target
        and errors.
        """
        compiled = kernel("stadera.trunk.kernels.errors")
        if compiled is None:
            moved = self.applied(products[1:, 1:])
            return float(np.trace(moved)), float(np.einsum("ij,ji->", moved, moved))
        wide, diagonal = np.empty((SHOWN.stop, 1 + ERRORS)), np.empty(ERRORS)
        wide[:, 0], wide[:, 1:] = 0.0, self.shown
        wide[:, 1 : 1 + SHOWN.stop] *= 0.5
        known, places = (self.variance, self.joints, self.sticking), (PLACES["offset"].start, STICKING.start)
        square: float = compiled.energies(products, wide, wide @ products, *known, *places, diagonal)
        return float(diagonal.sum()), square

    def replaced(self, shown: Array) -> Covariance:
        """With new rows `shown`."""
        joints, variance = self.joints.copy(), self.variance.copy()
        joints[SHOWN], joints[:, SHOWN] = shown[:, JOINTS], shown[:, JOINTS].T
        variance[SHOWN] = np.diagonal(shown)
        return Covariance(joints, self.sticking, variance, shown)

    def held(self, std: Array) -> Covariance:
        """With other standard deviations (12,) of static friction, and unchanged correlations."""
        ratio = std / np.maximum(np.sqrt(self.variance[STICKING]), 1e-300)
        variance, shown = self.variance.copy(), self.shown.copy()
        variance[STICKING] *= ratio**2
        shown[:, STICKING] *= ratio
        return Covariance(self.joints, self.sticking * ratio * ratio[:, None], variance, shown)


def _combined(covariance: Array, information: Array) -> Array:
    """(P⁻¹ + N)⁻¹ of P and N (n, n); P may be singular."""
    size = np.sqrt(np.diagonal(covariance))
    units = np.outer(size, size)
    P = covariance / np.where(units > 0.0, units, 1.0)
    system = P @ (information * units)
    system.flat[:: len(P) + 1] += 1.0
    found = np.linalg.solve(system, P) * units
    return np.asarray(0.5 * (found + found.T))


class Errors:
    """Mean p̂ and covariance Σ of the model errors, from the prior, swing legs, loaded rows and the scale of the fit.

    Attributes:
        mean: (ERRORS,). known: Σ. std: (ERRORS,).
    """

    def __init__(self, model: ErrorModel, swing: SwingJoints, scale: float, rows: RowSums | None = None) -> None:
        self._length = model.length
        joints, learned = swing.posterior(scale)
        self.mean = np.zeros(ERRORS)
        self.mean[JOINTS] = joints
        compiled = kernel("stadera.trunk.kernels.errors")
        if compiled is not None and rows is not None and rows.blocks:
            prior = learned.copy(), *model.scaled(scale)
            self._update(compiled, prior, model, None if swing.rows else model.variance[PLACES["coulomb"]], rows)
            return
        known = Covariance.of(model, scale, learned)
        if rows is not None:
            known = rows.update(self.mean, known)
        coulomb = PLACES["coulomb"]
        # rows under load tell friction as far as the direction of sliding is known, and noise at rest mimics that
        square = model.dry**2 + model.variance[coulomb]
        if swing.rows:
            square = (model.dry + self.mean[coulomb]) ** 2 + known.variance[coulomb]
        self.known = known.held(model.held * np.sqrt(square))
        self.std: Array = np.sqrt(self.known.variance)

    def _update(
        self,
        compiled: ModuleType,
        prior: tuple[Array, Array, Array],
        model: ErrorModel,
        unsure: Array | None,
        rows: RowSums,
    ) -> None:
        """The same by `stadera.trunk.kernels.errors`: of joints, static friction and all variances, updated.

        Args:
            unsure: (12,), variance of Coulomb friction where no swing has shown it.
        """
        joints, sticking, variance = prior
        shown, self.std = np.empty((SHOWN.stop, ERRORS)), np.empty(ERRORS)
        self.known = Covariance(joints, sticking, variance, shown)
        numbers = np.array([rows.blocks, rows.repeated, _QUIETEST, model.held])
        places = PLACES["coulomb"].start, STICKING.start
        friction = np.vstack([model.dry, np.full(12, -1.0) if unsure is None else unsure])
        compiled.update(
            self.mean, joints, sticking, variance, shown, self.std, rows.remainder, friction, numbers, *places
        )

    @property
    def covariance(self) -> Array:
        """Σ (ERRORS, ERRORS)."""
        return self.known.dense

    def trunk_covariance(self, segment: Segment, scatter: float) -> Array:
        """Covariance of a segment's trunk parameters, (10, 10); `scatter` is κ."""
        compiled = kernel("stadera.trunk.kernels.errors")
        if compiled is not None:
            own, out = self.known, np.empty((10, 10))
            known = own.joints, own.sticking, own.variance, own.shown
            rows = segment.inverse, segment.solution, segment.sums.values, by_force(self._length)
            compiled.trunk_covariance(*rows, *known, scatter, PLACES["offset"].start, STICKING.start, out)
            return out
        K = segment.sensitivity
        return np.asarray(self._of_rows(segment, scatter) + self.known.applied(K) @ K.T)

    def difference_covariance(self, first: Segment, second: Segment, scatter: float, stiction: bool = True) -> Array:
        """Covariance of the second segment's trunk parameters minus the first's, (10, 10).

        Errors that act on both alike cancel. Static friction of sticking joints may change with the load, and may even
        hide the load, so it does not cancel.

        Args:
            stiction: include a change of the static friction.
        """
        difference = second.sensitivity - first.sensitivity
        total = self.rows_covariance(first, second, scatter, stiction)
        total += self.known.applied(difference) @ difference.T
        regression = PLACES["regression"]
        changing = [(regression, np.diag(self.known.variance[regression]))]
        if stiction:
            changing.append((STICKING, self.known.sticking))
        for place, own in changing:
            K1, K2, D = (x[:, place] for x in (first.sensitivity, second.sensitivity, difference))
            total += K1 @ own @ K1.T + K2 @ own @ K2.T - D @ own @ D.T
        return np.asarray(0.5 * (total + total.T))

    def rows_covariance(self, first: Segment, second: Segment, scatter: float, stiction: bool = True) -> Array:
        """The part of `difference_covariance` that is due to the rows' scatter, and to static friction that varies."""
        return self._of_rows(first, scatter, stiction) + self._of_rows(second, scatter, stiction)

    def _of_rows(self, segment: Segment, scatter: float, stiction: bool = True) -> Array:
        """Covariance (10, 10) due to the rows' scatter, and to static friction that varies while the robot sways."""
        P = segment.inverse @ segment.inverse.T
        if not stiction:
            return scatter * P
        return scatter * P + P @ segment.sums.follows_motion(self.known.sticking, self._length) @ P


def robot_weight(robot: Robot) -> float:
    """Weight of the robot model [N]."""
    return GRAVITY * robot.mass
