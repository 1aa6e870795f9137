"""Regression calibration: noise taken out of the accelerations that enter the trunk's rows.

Least squares takes noise in its matrix for motion: on a robot that stands still it would estimate inertia and height
from noise alone, wrongly and with ever smaller error bars. So an acceleration x measured with noise of variance n²
enters the matrix as its best guess,

    E[x | measured] = x̄ + g (x - x̄),      g = 1 - n² / var(x)

where that variance, over the last second, exceeds the noise by far, and g = 0 where it does not. x̄ is zero for the
angular acceleration, and for the specific force its average over the last second turned along with the trunk, which is
gravity. The guess is right for Gaussian motion; of intermittent motion it removes too much of the large values, always
with the same sign. So what it removes of the angular acceleration is returned too, and counts as a considered error.
"""

from __future__ import annotations

from math import exp

import numpy as np

from stadera.types import Array

_MEMORY = 1.0  # s
_BEYOND_NOISE = 2.0  # times the noise's variance, from which there is motion


class SignalCalibration:
    """Takes noise out of the twelve signals of the trunk's rows, block by block."""

    def __init__(self) -> None:
        self._weight = 0.0
        self._variance = np.zeros(6)
        self._average = np.zeros(3)

    def calibrated(self, signals: Array, noise: Array, turned: Array, elapsed: float) -> tuple[Array, Array]:
        """The signals with specific force and angular acceleration as they most likely are, and what was removed.

        Args:
            signals: (12,), see `stadera.trunk.wrench.trunk_signals`.
            noise: (6,), variances of the first six.
            turned: (3, 3), takes trunk components of what is fixed in the world from the last block to this.
            elapsed: [s] since the last block.

        Returns:
            The signals (12,), and what was taken away of the angular acceleration (3,) [rad/s²].
        """
        keep = exp(-elapsed / _MEMORY)
        self._weight = keep * self._weight + 1.0 - keep
        share = (1.0 - keep) / self._weight
        force = signals[:3]
        carried = turned @ self._average
        self._average = carried + share * (force - carried)
        mean = np.concatenate([self._average, np.zeros(3)])
        away = signals[:6] - mean
        self._variance += share * (away * away - self._variance)
        sure = self._variance > _BEYOND_NOISE * noise
        gain = np.where(sure, 1.0 - noise / np.where(sure, self._variance, 1.0), 0.0)
        guess = mean + gain * away
        return np.concatenate([guess, signals[6:]]), (1.0 - gain[3:]) * away[3:]
