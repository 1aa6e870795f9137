"""Information on the trunk and on the model errors, summed up over the blocks since the last change of the load.

Rows A θ + C p = b, weighted by a constant W, are summed up to R θ + G p = z. With p of mean p̂ and covariance Σ,

    θ̂ = R⁻¹ (z - G p̂),      cov θ̂ = κ R⁻¹ R⁻ᵀ + K Σ Kᵀ,      K = R⁻¹ G

The rows that remain after θ is eliminated tell p (`stadera.trunk.joint_errors`). κ is the ratio of the actual scatter
of summed rows to that given by W.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from math import isnan, sqrt

import numpy as np

from stadera.compiled import kernel
from stadera.information import Information, Unknowns
from stadera.trunk.equations import Equations
from stadera.trunk.error_model import ERRORS, PLACES
from stadera.trunk.wrench import TRUNK_MAP
from stadera.types import Array

THETA = Unknowns.of(theta=10)
STICTION = slice(11 + PLACES["stiction"].start, 11 + PLACES["stiction"].stop)
"""Columns of `WeightedRows.columns`: of static friction."""
BY_FORCE: Array = TRUNK_MAP.reshape(6, 10, 12)[:, :, :3]
"""(6, 10, 3): derivatives of the trunk's matrix A by the specific force."""
PROJECTED = 10 + 1 + ERRORS + 1
"""Columns of `WeightedRows.projected`: of A, b, C, and the weight."""


@lru_cache(maxsize=16)
def by_force(length: float) -> Array:
    """Derivatives (10, 18) of the rows' matrix in their unit by the specific force, by row and axis; `length` is the
    lever of the moments [m].
    """
    unit = np.array([1.0, 1.0, 1.0, length, length, length])
    return np.ascontiguousarray((BY_FORCE / unit[:, None, None]).transpose(1, 0, 2).reshape(10, 18))


@dataclass(frozen=True, eq=False)
class WeightedRows(Equations):
    """Six rows of one block, in the unit of `stadera.trunk.row_sums.weighted`.

    Attributes:
        time: of the last sample [s].
        columns: (6, 10 + 1 + ERRORS), of A, b and C.
        white: variance of the white noise, summed over the six rows [1].
        weight: of the rows in sums [1], see `stadera.trunk.scatter.RobustWeights`.
    """

    time: float
    columns: Array
    white: float
    weight: float = 1.0

    @classmethod
    def of(cls, time: float, matrix: Array, errors: Array, target: Array, white: float) -> WeightedRows:
        """From A (6, 10), C (6, ERRORS) and b (6,)."""
        return cls(time, np.hstack([matrix, target[:, None], errors]), white)

    def residual(self, trunk: Array, errors: Array) -> Array:
        """b - A θ - C p (6,), for θ (10,) and p (ERRORS,)."""
        return np.asarray(self.columns @ np.concatenate([-trunk, [1.0], -errors]))

    @property
    def moving(self) -> bool:
        """True if at least half of the joints move. The columns of a robot at rest are noise, and its friction holds
        what it likes: they tell nothing about the errors of its model.
        """
        return int(np.count_nonzero(self.columns[:, STICTION].any(axis=0))) <= 6

    @cached_property
    def projected(self) -> Array:
        """(4, PROJECTED): the rows projected on the specific force a, for the differences in mass and in first moment:
        a · r_force and a x r_moment of A, b and C, and the square of a.
        """
        A = self.columns
        along = A[:3, 0]
        x, y, z = across = np.array([A[4, 3], A[5, 1], A[3, 2]])  # of r_moment = -[across]x h
        seen = np.array([[*along, 0, 0, 0], [0, 0, 0, 0, -z, y], [0, 0, 0, z, 0, -x], [0, 0, 0, -y, x, 0]])
        out = np.empty((4, A.shape[1] + 1))
        np.matmul(seen, A, out=out[:, :-1])
        out[:, -1] = across @ across
        out[0, -1] = along @ along
        return out


@dataclass(frozen=True, eq=False)
class RowMoments:
    """Weighted sums over blocks, with the same forgetting as `Segment.known`.

    Attributes:
        values: (85,), Σ of the weights; Σ a (3), the specific force in the unit of the rows; Σ a aᵀ (3, 3); and the
            summed columns of static friction (6, 12).
    """

    values: Array = field(default_factory=lambda: np.zeros(85))

    def add(self, rows: WeightedRows, keep: float) -> RowMoments:
        """With one more block, the weight of everything before it multiplied by `keep`."""
        a = rows.columns[:3, 0]
        own = np.concatenate([[1.0], a, np.outer(a, a).ravel(), rows.columns[:, STICTION].ravel()])
        return RowMoments(keep * self.values + rows.weight * own)

    def follows_motion(self, covariance: Array, length: float) -> Array:
        """Variance (10, 10) of Σ Aᵀ e due to an error e(t) of the rows that varies with the specific force.

        e(t) has the covariance S = C̄ Σ C̄ᵀ of static friction, and is proportional to some component of the deviation
        of a from its mean; which one is not known, so each of the three gets a third of the variance. With
        A = Σ_u a_u A_u + ... and N the weight,

            Σ Aᵀ e = N Σ_u A_uᵀ Γ^½_u. e0,      N²/3 Σ_uv Γ_uv A_uᵀ S A_v,      Γ = cov a

        Args:
            covariance: Σ (12, 12), of static friction [N²·m²].
            length: lever of the moments in the unit of the rows [m].
        """
        weight = float(self.values[0])
        if not weight:
            return np.zeros((10, 10))
        mean, products, stiction = np.split(self.values[1:] / weight, [3, 12])
        error = stiction.reshape(6, 12) @ covariance @ stiction.reshape(6, 12).T
        moved = products.reshape(3, 3) - mean[:, None] * mean
        left = by_force(length)
        right = left.reshape(10, 6, 3) @ moved
        return np.asarray(weight**2 / 3.0 * (left @ (error @ right).reshape(10, 18).T))


@dataclass(frozen=True, eq=False)
class Segment:
    """Summed rows.

    Attributes:
        triangle: (10, 10 + 1 + ERRORS), R, z and G.
        cost: sum of squared residuals that no trunk explains [1]. count: number of rows, with forgetting.
        white: Σ of the rows' white variance [1].
        begin: time of the first row [s].
        blocks: number of blocks.
        sums: means and variation of the rows.
        moved: sum of the weights of blocks in which the robot moves [1].
    """

    triangle: Array
    cost: float = 0.0
    count: float = 0.0
    white: float = 0.0
    begin: float = np.nan
    blocks: int = 0
    sums: RowMoments = field(default_factory=RowMoments)
    moved: float = 0.0
    _last: list[tuple[Segment, float, Array, bool]] = field(default_factory=list, repr=False)

    @classmethod
    def prior(cls, mean: Array, std: Array) -> Segment:
        """The prior of the trunk, mean and standard deviation (10,), before any row."""
        triangle = np.zeros((10, 11 + ERRORS))
        triangle[:, :10], triangle[:, 10] = np.diag(1.0 / std), mean / std
        return cls(triangle)

    def add(self, rows: WeightedRows, keep: float = 1.0, remainder: bool = True) -> Segment:
        """Returns the segment with one more block, the weight of everything before it multiplied by `keep`.

        Args:
            remainder: keep what `remainder` needs.
        """
        triangle, residue = _folded(self.triangle, sqrt(rows.weight) * rows.columns, sqrt(keep))
        return self.followed(rows, keep, triangle, residue, self.sums.add(rows, keep), remainder)

    def followed(
        self, rows: WeightedRows, keep: float, triangle: Array, residue: Array, sums: RowMoments, remainder: bool = True
    ) -> Segment:
        """Returns the segment with one more block, given its triangle, the six rows (6, 1 + ERRORS) of target and
        errors that the block leaves after eliminating θ, and its sums.
        """
        left, moving = residue[:, 0], rows.moving
        return Segment(
            triangle,
            keep * self.cost + float(left @ left),
            keep * self.count + 6.0 * rows.weight,
            keep * self.white + rows.weight * rows.white,
            rows.time if isnan(self.begin) else self.begin,
            self.blocks + 1,
            sums,
            keep * self.moved + rows.weight * moving,
            [(self, keep, residue, moving)] if remainder else [],
        )

    def with_solution(self, inverse: Array, solution: Array, errors: Array, mean: Array) -> Segment:
        """Stores `inverse`, `solution` and the mean for errors p̂, which are known already, and returns itself."""
        self.__dict__.update(inverse=inverse, solution=solution, _mean=(errors, mean))
        return self

    @property
    def weight(self) -> float:
        """Sum of the weights of the blocks, with forgetting [1]."""
        return float(self.sums.values[0])

    @property
    def known(self) -> Information:
        """R, z and G as information."""
        T = self.triangle
        return Information(THETA, T[:, :10], T[:, 10], T[:, 11:], self.cost, self.count)

    @property
    def remainder(self) -> Array:
        """(1 + ERRORS, 1 + ERRORS), products of targets and errors, summed over all rows after eliminating θ."""
        return self._remainders[0] + self._remainders[1]

    @property
    def in_motion(self) -> Array:
        """The same of blocks in which the robot moves."""
        return self._remainders[1]

    @cached_property
    def _remainders(self) -> tuple[Array, Array]:
        """Of blocks at rest, and of blocks in motion.

        Each block adds the products of the rows that it leaves. They are summed on first use, over all blocks since the
        last segment whose remainders are known: one product of stacked rows instead of one a block.
        """
        scale, residues, at = 1.0, ([], []), self  # type: float, tuple[list[Array], list[Array]], Segment
        while at._last and "_remainders" not in at.__dict__:
            before, keep, residue, moving = at._last[0]
            residues[moving].append(sqrt(scale) * residue)
            scale, at = scale * keep, before
        self._last.clear()
        known = at.__dict__.get("_remainders", (None, None))
        return _summed(residues[0], scale, known[0]), _summed(residues[1], scale, known[1])

    @cached_property
    def inverse(self) -> Array:
        """R⁻¹, (10, 10)."""
        return self._solved[0]

    @property
    def sensitivity(self) -> Array:
        """K (10, ERRORS): errors p that are not subtracted move the estimate by K p."""
        return self.solution[:, 1:]

    @cached_property
    def solution(self) -> Array:
        """R⁻¹ z and K, (10, 1 + ERRORS)."""
        return self._solved[1]

    def mean(self, errors: Array) -> Array:
        """θ̂ (10,), given errors p̂ (ERRORS,)."""
        last = self.__dict__.get("_mean")
        if last is None or last[0] is not errors:
            last = self.__dict__["_mean"] = errors, self.solution[:, 0] - self.sensitivity @ errors
        return np.asarray(last[1])

    @cached_property
    def _solved(self) -> tuple[Array, Array]:
        compiled = kernel("stadera.trunk.kernels.sums")
        if compiled is None:
            inverse = np.asarray(self.known.inverse)
            return inverse, inverse @ self.triangle[:, 10:]
        inverse, solution = np.empty((10, 10)), np.empty((10, 1 + ERRORS))
        compiled.solve(self.triangle, inverse, solution)
        return inverse, solution


def _summed(residues: list[Array], scale: float, known: Array | None) -> Array:
    """Products of residues, and `scale` times those that are known; None for zero."""
    if not residues:
        return np.zeros((1 + ERRORS, 1 + ERRORS)) if known is None else scale * known
    stacked = np.concatenate(residues)
    total: Array = stacked.T @ stacked
    if known is None:
        return total
    compiled = kernel("stadera.trunk.kernels.errors")
    if compiled is None:
        total += scale * known
    else:
        compiled.add_scaled(total, scale, known)
    return total


def _folded(triangle: Array, columns: Array, root: float) -> tuple[Array, Array]:
    """A triangle [R z G], multiplied by `root`, with the rows [A b C] added, and the rows [0 b C] that these leave."""
    compiled = kernel("stadera.trunk.kernels.sums")
    if compiled is not None:
        out, left = np.empty(triangle.shape), columns.copy()
        compiled.fold(triangle, left, root, out)
        return out, np.ascontiguousarray(left[:, 10:])
    stacked = np.vstack([root * triangle, columns])
    rotation, R = np.linalg.qr(stacked[:, :10], mode="complete")
    turned = rotation.T @ stacked[:, 10:]
    return np.hstack([R[:10], turned[:10]]), turned[10:]
