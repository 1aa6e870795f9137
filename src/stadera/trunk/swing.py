"""Estimates the joints' rotor inertia, friction and offset from legs that swing in the air.

A leg in the air has no contact force, so each of its joints obeys

    h + I_r q̈ + b q̇ + c s + o = τ(t),        τ(t) = τ_measured(t) + d τ̇_measured(t)

with h of the rigid bodies, s the smoothed sign of q̇ and d the torques' lag, common to all joints. The trunk's mass
does not enter these rows, so wrong torques under load cannot affect them. A friction law errs alike over a whole swing,
so `repeated` rows count as one.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from stadera.trunk.error_model import JOINTS, PLACES, ErrorModel
from stadera.trunk.settings import SwingDetection
from stadera.types import Array

_TERMS = ("rotor", "viscous", "coulomb", "offset")
_COUNT = JOINTS.stop
_ENOUGH = 4 * _COUNT  # rows needed to evaluate the fit of the joints' law
_QUIETEST = 0.02  # of the stated variance: smaller residuals do not sharpen the estimate further
_WILD = 5.0  # standard deviations of the residual, beyond which a row is skipped


class SwingJoints:
    """Least squares over swing rows, around the prior.

    Args:
        errors: the prior.
        settings: of swing rows.

    Attributes:
        rows: number of rows so far.
    """

    def __init__(self, errors: ErrorModel, settings: SwingDetection) -> None:
        self._limit, self._settings = errors.limit, settings
        self._prior = np.linalg.inv(errors.covariance[JOINTS, JOINTS])
        self._normal, self._right = np.zeros((_COUNT, _COUNT)), np.zeros(_COUNT)
        self._square, self.rows = 0.0, 0
        self._last, self._limit_square = np.zeros(_COUNT), np.inf
        self._found: tuple[float, Array, Array] | None = None

    def add(self, air: NDArray[np.bool_], terms: Array, rate: Array, residual: Array, white: Array) -> None:
        """Adds one block.

        Args:
            air: (4,) bool, the legs in the air throughout the block.
            terms: (4, 12), averages of q̈, q̇, s and 1 by joint.
            rate: (12,) [N·m/s], of the torques. residual: (12,) [N·m], h - τ_measured.
            white: (12,) [N·m], standard deviation of its white noise.
        """
        for joint in np.flatnonzero(np.repeat(air, 3)):
            row = np.zeros(_COUNT)
            for name, value in zip(_TERMS, terms[:, joint], strict=True):
                row[PLACES[name].start + joint] = value
            row[PLACES["torque_lag"].start] = -rate[joint]
            weight = 1.0 / (white[joint] ** 2 + (self._settings.residual * self._limit[joint]) ** 2)
            used = np.flatnonzero(row)
            if self._is_wild(residual[joint] + row @ self._last, weight):
                continue
            self._normal[np.ix_(used, used)] += weight * np.outer(row[used], row[used])
            self._right[used] -= weight * residual[joint] * row[used]
            self._square += weight * residual[joint] ** 2
            self.rows += 1
            self._found = None

    def _is_wild(self, left: float, weight: float) -> bool:
        """True if a row's residual is far beyond the others'."""
        return weight * left**2 > self._limit_square

    @property
    def misfit(self) -> float:
        """Variance of the rows' residual divided by the stated one."""
        if self.rows < _ENOUGH:
            return 1.0
        mean, _ = self.posterior(1.0)
        return float(self._square - mean @ (2.0 * self._right - self._normal @ mean)) / self.rows

    def posterior(self, scale: float) -> tuple[Array, Array]:
        """Mean (49,) and covariance (49, 49) of the errors that swing rows determine, in the order of `JOINTS`.

        Args:
            scale: factor on the prior's standard deviations.
        """
        if self._found is None or abs(self._found[0] / scale - 1.0) > 0.05:
            loud, information, mean = self._settings.repeated, self._prior, self._right
            for _ in range(2):  # the second pass uses the first one's residual
                information = self._normal / loud + self._prior / scale**2
                mean = np.linalg.solve(information, self._right / loud)
                if self.rows > _COUNT:
                    square = self._square - mean @ (2.0 * self._right - self._normal @ mean)
                    loud = self._settings.repeated * max(float(square) / self.rows, _QUIETEST)
            self._found = scale, mean, np.linalg.inv(information)
            if self.rows > _ENOUGH:
                self._last, self._limit_square = mean, _WILD**2 * loud / self._settings.repeated
        return self._found[1], self._found[2]
