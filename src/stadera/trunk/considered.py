"""Weights the rows, and computes the trunk and its covariance from the summed rows with considered errors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from stadera.compiled import kernel
from stadera.constants import GRAVITY
from stadera.robot.model import Robot
from stadera.trunk.error_model import BLOCKS, ERRORS, HELD, JOINTS, PLACES, SHOWN, ErrorModel
from stadera.trunk.rows import BlockRows
from stadera.trunk.segment import Segment, WeightedRows, summed_remainder
from stadera.trunk.swing import SwingJoints
from stadera.types import Array

_QUIETEST = 0.25  # squared residuals below those of 0.5 % of the weight do not sharpen the estimate further
_UNIT = 0.01  # of weight, and of weight times leg length: the unit of the rows
_EDGES = np.array([SHOWN.stop, JOINTS.stop, BLOCKS[1].start, BLOCKS[1].stop])


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

    An error in one row persists through half a step, so s is the residual's variance times `repeated`.

    Attributes:
        remainder: see `Segment.remainder`, summed over segments. blocks: number of blocks.
        repeated: number of successive rows with the same error [1].
    """

    remainder: Array
    blocks: int
    repeated: float

    @classmethod
    def of(cls, segments: Sequence[Segment], repeated: float) -> RowSums:
        """Sums up segments of the same robot."""
        return cls(summed_remainder(segments), sum(segment.blocks for segment in segments), repeated)

    def update(self, mean: Array, covariance: Array) -> None:
        """Updates p̂ (ERRORS,) and Σ (ERRORS, ERRORS), which is diagonal outside `BLOCKS`, in place."""
        if not self.blocks:
            return
        compiled = kernel("stadera.trunk.kernels.errors")
        if compiled is not None:
            compiled.update(mean, covariance, self.remainder, self.blocks, self.repeated, _QUIETEST, _EDGES)
            return
        along = self.remainder[1:, 0] - self.remainder[1:, 1:][:, JOINTS] @ mean[JOINTS]
        square = float(self.remainder[0, 0] - (self.remainder[1:, 0] + along) @ mean)
        loud = self.repeated * max(square / (6.0 * self.blocks), _QUIETEST)
        k, normal = SHOWN, self.remainder[1:, 1:][SHOWN] / loud
        found = _combined(covariance[k, k], normal[:, k])
        mean[k] += found @ along[k] / loud
        spread = normal * np.diagonal(covariance)  # N Σ
        for block in BLOCKS:
            spread[:, block] = normal[:, block] @ covariance[block, block]
        moved = covariance[k] - found @ spread
        own = moved[:, k] + (found @ normal[:, k] - moved @ normal.T) @ found
        covariance[k], covariance[:, k] = moved, moved.T
        covariance[k, k] = 0.5 * (own + own.T)


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
        mean: (ERRORS,). covariance: (ERRORS, ERRORS). std: (ERRORS,).
    """

    def __init__(self, model: ErrorModel, swing: SwingJoints, scale: float, rows: RowSums | None = None) -> None:
        self._length = model.length
        joints, learned = swing.posterior(scale)
        self.mean = np.zeros(ERRORS)
        self.mean[JOINTS] = joints
        self.covariance = model.scaled(scale)
        self.covariance[JOINTS, JOINTS] = learned
        if rows is not None:
            rows.update(self.mean, self.covariance)
        place, coulomb = PLACES["stiction"], PLACES["coulomb"]
        # rows under load tell friction as far as the direction of sliding is known, and noise at rest mimics that
        dry = np.sqrt(np.diag(model.covariance)[coulomb])
        if swing.rows:
            dry = np.sqrt(self.mean[coulomb] ** 2 + np.diag(self.covariance)[coulomb])
        ratio = HELD * dry / np.maximum(np.sqrt(np.diag(self.covariance)[place]), 1e-300)
        self.covariance[place] *= ratio[:, None]
        self.covariance[:, place] *= ratio
        self.std: Array = np.sqrt(np.diag(self.covariance))

    def trunk_covariance(self, segment: Segment, scatter: float) -> Array:
        """Covariance of a segment's trunk parameters, (10, 10); `scatter` is κ."""
        K = segment.sensitivity
        return np.asarray(self._of_rows(segment, scatter) + K @ self.covariance @ K.T)

    def difference_covariance(self, first: Segment, second: Segment, scatter: float, stiction: bool = True) -> Array:
        """Covariance of the second segment's trunk parameters minus the first's, (10, 10).

        Errors that act on both alike cancel. Static friction of sticking joints may change with the load, and may even
        hide the load, so it does not cancel.

        Args:
            stiction: include a change of the static friction.
        """
        difference = second.sensitivity - first.sensitivity
        total = self._of_rows(first, scatter, stiction) + self._of_rows(second, scatter, stiction)
        total += difference @ self.covariance @ difference.T
        for name in ("stiction",) * stiction + ("regression",):
            place = PLACES[name]
            K1, K2, D = (x[:, place] for x in (first.sensitivity, second.sensitivity, difference))
            own = self.covariance[place, place]
            total += K1 @ own @ K1.T + K2 @ own @ K2.T - D @ own @ D.T
        return np.asarray(0.5 * (total + total.T))

    def _of_rows(self, segment: Segment, scatter: float, stiction: bool = True) -> Array:
        """Covariance (10, 10) due to the rows' scatter, and to static friction that varies while the robot sways."""
        P = segment.inverse @ segment.inverse.T
        if not stiction:
            return scatter * P
        place = PLACES["stiction"]
        return scatter * P + P @ segment.sums.follows_motion(self.covariance[place, place], self._length) @ P


def robot_weight(robot: Robot) -> float:
    """Weight of the robot model [N]."""
    return GRAVITY * robot.mass
