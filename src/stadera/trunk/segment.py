"""Information on the trunk and on the model errors, summed up over the blocks since the last change of the load.

Rows A θ + C p = b, weighted by a constant W, are summed up to R θ + G p = z. With p of mean p̂ and covariance Σ,

    θ̂ = R⁻¹ (z - G p̂),      cov θ̂ = κ R⁻¹ R⁻ᵀ + K Σ Kᵀ,      K = R⁻¹ G

p is not estimated from these rows (Schmidt's consider parameters): under load a constant torque cannot be separated
from weight, and a free parameter absorbs other errors. κ is the ratio of the actual scatter of summed rows to that
given by W.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from math import isnan, sqrt
from typing import NamedTuple

import numpy as np

from stadera.compiled import kernel
from stadera.information import Information, Unknowns
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


@dataclass(frozen=True, eq=False)
class WeightedRows:
    """Six rows of one block, in the unit of `stadera.trunk.considered.weighted`.

    Attributes:
        time: of the last sample [s].
        columns: (6, 10 + 1 + ERRORS), of A, b and C.
        white: variance of the white noise, summed over the six rows [1].
    """

    time: float
    columns: Array
    white: float

    @classmethod
    def of(cls, time: float, matrix: Array, errors: Array, target: Array, white: float) -> WeightedRows:
        """From A (6, 10), C (6, ERRORS) and b (6,)."""
        return cls(time, np.hstack([matrix, target[:, None], errors]), white)

    @property
    def matrix(self) -> Array:
        """A (6, 10)."""
        return self.columns[:, :10]

    @property
    def target(self) -> Array:
        """b (6,)."""
        return self.columns[:, 10]

    @property
    def errors(self) -> Array:
        """C (6, ERRORS)."""
        return self.columns[:, 11:]

    def residual(self, trunk: Array, errors: Array) -> Array:
        """b - A θ - C p (6,), for θ (10,) and p (ERRORS,)."""
        return np.asarray(self.columns @ np.concatenate([-trunk, [1.0], -errors]))

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


class RowMoments(NamedTuple):
    """Weighted sums over blocks, with the same forgetting as `Segment.known`.

    Attributes:
        weight: Σ of the weights.
        force: Σ a, (3,), the specific force in the unit of the rows. stiction: Σ of the columns of static friction,
            (6, 12).
        products: Σ a aᵀ (3, 3).
    """

    weight: float = 0.0
    force: Array = np.zeros(3)
    stiction: Array = np.zeros((6, 12))
    products: Array = np.zeros((3, 3))

    def add(self, rows: WeightedRows, keep: float) -> RowMoments:
        """With one more block, the weight of everything before it multiplied by `keep`."""
        a = rows.columns[:3, 0]
        return RowMoments(
            keep * self.weight + 1.0,
            keep * self.force + a,
            keep * self.stiction + rows.columns[:, STICTION],
            keep * self.products + a[:, None] * a,
        )

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
        if not self.weight:
            return np.zeros((10, 10))
        stiction = self.stiction / self.weight
        error = stiction @ covariance @ stiction.T
        mean = self.force / self.weight
        moved = self.products / self.weight - mean[:, None] * mean
        by_force = BY_FORCE / np.array([1.0, 1.0, 1.0, length, length, length])[:, None, None]
        left = by_force.transpose(1, 0, 2).reshape(10, 18)
        right = np.tensordot(error, by_force @ moved, 1).transpose(1, 0, 2).reshape(10, 18)
        return np.asarray(self.weight**2 / 3.0 * (left @ right.T))


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
    """

    triangle: Array
    cost: float = 0.0
    count: float = 0.0
    white: float = 0.0
    begin: float = np.nan
    blocks: int = 0
    sums: RowMoments = field(default_factory=lambda: RowMoments())
    _last: list[tuple[Segment, float, WeightedRows]] = field(default_factory=list, repr=False)

    @classmethod
    def prior(cls, mean: Array, std: Array) -> Segment:
        """The prior of the trunk, mean and standard deviation (10,), before any row."""
        triangle = np.zeros((10, 11 + ERRORS))
        triangle[:, :10], triangle[:, 10] = np.diag(1.0 / std), mean / std
        return cls(triangle)

    def add(self, rows: WeightedRows, keep: float = 1.0, energy: bool = True) -> Segment:
        """Returns the segment with one more block, the weight of everything before it multiplied by `keep`.

        Args:
            energy: keep what `energy` needs.
        """
        return self.followed(rows, keep, *_folded(self.triangle, rows.columns, sqrt(keep)), energy)

    def followed(self, rows: WeightedRows, keep: float, triangle: Array, cost: float, energy: bool = True) -> Segment:
        """Returns the segment with one more block, given its triangle and what the block adds to the cost."""
        return Segment(
            triangle,
            keep * self.cost + cost,
            keep * self.count + 6.0,
            keep * self.white + rows.white,
            rows.time if isnan(self.begin) else self.begin,
            self.blocks + 1,
            self.sums.add(rows, keep),
            [(self, keep, rows)] if energy else [],
        )

    def with_solution(self, inverse: Array, solution: Array, errors: Array, mean: Array) -> Segment:
        """Stores `inverse`, `solution` and the mean for errors p̂, which are known already, and returns itself."""
        self.__dict__["_solved"], self.__dict__["_mean"] = (inverse, solution), (errors, mean)
        return self

    @property
    def known(self) -> Information:
        """R, z and G as information."""
        T = self.triangle
        return Information(THETA, T[:, :10], T[:, 10], T[:, 11:], self.cost, self.count)

    @cached_property
    def energy(self) -> Array:
        """(1 + ERRORS, 1 + ERRORS), products of targets and errors, summed.

        Summed on first use, over all blocks since the last segment whose energy is known: one product of stacked rows
        instead of one a block.
        """
        scale, columns, at = 1.0, [], self
        while at._last and "energy" not in at.__dict__:
            before, keep, rows = at._last[0]
            columns.append(sqrt(scale) * rows.columns[:, 10:])
            scale, at = scale * keep, before
        self._last.clear()
        known = at.__dict__.get("energy")
        stacked = np.vstack(columns) if columns else np.zeros((0, 1 + ERRORS))
        total: Array = stacked.T @ stacked
        if known is not None:
            total += scale * known
        return total

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

    @cached_property
    def remainder(self) -> Array:
        """`energy` after eliminating θ."""
        explained = self.triangle[:, 10:]
        return np.asarray(self.energy - explained.T @ explained)

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


def summed_remainder(segments: Sequence[Segment]) -> Array:
    """Sum of the segments' `remainder`, not to be written into."""
    total = segments[0].remainder
    for segment in segments[1:]:
        total = total + segment.remainder
    return total


def _folded(triangle: Array, columns: Array, root: float) -> tuple[Array, float]:
    """A triangle [R z G], multiplied by `root`, with the rows [A b C] added, and what these add to the cost."""
    compiled = kernel("stadera.trunk.kernels.sums")
    if compiled is not None:
        out = np.empty(triangle.shape)
        return out, compiled.fold(triangle, np.ascontiguousarray(columns), root, out)
    T = root * triangle
    known = Information(THETA, T[:, :10], T[:, 10], T[:, 11:]).add(columns[:, :10], columns[:, 10], columns[:, 11:])
    return np.hstack([known.R, known.z[:, None], known.G]), known.cost
