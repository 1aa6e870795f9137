"""Information on the trunk and on the model errors, summed up over the blocks since the last change of the load.

Rows A θ + C p = b, weighted by a constant W, are summed up to R θ + G p = z. With p of mean p̂ and covariance Σ,

    θ̂ = R⁻¹ (z - G p̂),      cov θ̂ = κ R⁻¹ R⁻ᵀ + K Σ Kᵀ,      K = R⁻¹ G

p is not estimated from these rows (Schmidt's consider parameters): under load a constant torque cannot be separated
from weight, and a free parameter absorbs other errors. κ is the ratio of the actual scatter of summed rows to that
given by W.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from stadera.inertia import skew
from stadera.information import Information, Unknowns
from stadera.trunk.error_model import ERRORS
from stadera.types import Array

THETA = Unknowns.of(theta=10)
PROJECTED = 10 + 1 + ERRORS + 1
"""Columns of `WeightedRows.projected`: of A, b, C, and the weight."""


@dataclass(frozen=True, eq=False)
class WeightedRows:
    """Six rows of one block, in the unit of `stadera.trunk.considered.weighted`.

    Attributes:
        time: of the last sample [s].
        matrix: (6, 10). errors: (6, ERRORS). target: (6,).
        white: variance of the white noise, summed over the six rows [1].
    """

    time: float
    matrix: Array
    errors: Array
    target: Array
    white: float

    @cached_property
    def moments(self) -> Array:
        """Columns of mass and first moment times all columns, (4, 10 + 1 + ERRORS)."""
        return np.asarray(self.matrix[:, :4].T @ np.hstack([self.matrix, self.target[:, None], self.errors]))

    @cached_property
    def projected(self) -> Array:
        """(4, PROJECTED): the rows projected on the specific force a, for the differences in mass and in first moment:
        a · r_force and a x r_moment of A, b and C, and the square of a.
        """
        columns = np.hstack([self.matrix, self.target[:, None], self.errors])
        along = self.matrix[:3, 0]
        across = np.array([self.matrix[4, 3], self.matrix[5, 1], self.matrix[3, 2]])  # of r_moment = -[across]x h
        out = np.empty((4, columns.shape[1] + 1))
        out[0, :-1] = along @ columns[:3]
        out[1:, :-1] = skew(across) @ columns[3:]
        out[:, -1] = across @ across
        out[0, -1] = along @ along
        return out

    @cached_property
    def energy(self) -> Array:
        """Products of target and errors, (1 + ERRORS, 1 + ERRORS)."""
        columns = np.hstack([self.target[:, None], self.errors])
        return np.asarray(columns.T @ columns)


@dataclass(frozen=True, eq=False)
class Segment:
    """Summed rows.

    Attributes:
        known: R, z and G.
        energy: (1 + ERRORS, 1 + ERRORS), products of targets and errors, summed.
        white: Σ of the rows' white variance [1].
        begin: time of the first row [s].
        blocks: number of blocks.
    """

    known: Information
    energy: Array
    white: float = 0.0
    begin: float = np.nan
    blocks: int = 0

    @classmethod
    def prior(cls, mean: Array, std: Array) -> Segment:
        """The prior of the trunk, mean and standard deviation (10,), before any row."""
        return cls(Information.prior(THETA, mean, std, ERRORS), np.zeros((1 + ERRORS, 1 + ERRORS)))

    def add(self, rows: WeightedRows, keep: float = 1.0) -> Segment:
        """Returns the segment with one more block, the weight of everything before it multiplied by `keep`."""
        known = self.known if keep == 1.0 else self.known.forget(keep)
        return Segment(
            known.add(rows.matrix, rows.target, rows.errors),
            keep * self.energy + rows.energy,
            keep * self.white + rows.white,
            rows.time if np.isnan(self.begin) else self.begin,
            self.blocks + 1,
        )

    @cached_property
    def inverse(self) -> Array:
        """R⁻¹, (10, 10)."""
        return np.asarray(self.known.inverse)

    @cached_property
    def sensitivity(self) -> Array:
        """K (10, ERRORS): the estimate's error due to p is -K p."""
        return np.asarray(self.inverse @ self.known.G)

    @cached_property
    def remainder(self) -> Array:
        """`energy` after eliminating θ."""
        explained = np.hstack([self.known.z[:, None], self.known.G])
        return np.asarray(self.energy - explained.T @ explained)

    def mean(self, errors: Array) -> Array:
        """θ̂ (10,), given errors p̂ (ERRORS,)."""
        return np.asarray(self.inverse @ self.known.z - self.sensitivity @ errors)
