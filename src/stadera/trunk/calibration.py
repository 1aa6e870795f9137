"""Regression calibration: removes noise from the accelerations that enter the matrix of the trunk's rows.

Noise in the matrix biases least squares: on a robot at rest it would yield estimates of inertia and height from noise
alone, wrong and with shrinking error bars. So an acceleration x measured with noise of variance n² enters the matrix as
its conditional mean,

    E[x | measured] = x̄ + g (x - x̄),      g = 1 - n² / var(x)

where var(x), computed over the last second, is well above n², and g = 0 elsewhere. x̄ is zero for the angular
acceleration. For the specific force it is the average over the last second, rotated with the trunk, which is gravity.
The conditional mean is right for Gaussian motion; of intermittent motion it removes too much of the large values,
always with the same sign. So the part removed from the angular acceleration is returned too, and becomes a considered
error.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import exp

import numpy as np

from stadera.constants import GRAVITY
from stadera.types import Array


@dataclass(frozen=True)
class CalibrationSettings:
    """Settings of the calibration.

    Attributes:
        memory: time over which variances and gravity are averaged [s].
        struck: most that a block counts in the average of the specific force [m/s²]: impacts are not gravity.
        beyond: multiple of the noise's variance above which the robot is taken to move.
    """

    memory: float = 1.0
    struck: float = 0.5 * GRAVITY
    beyond: float = 2.0


class SignalCalibration:
    """Removes noise from the signals of the trunk's rows, block by block; `settings` None for the defaults.

    Attributes:
        average: (3,) [m/s²], of the specific force over the last second, turned with the trunk: gravity.
    """

    def __init__(self, settings: CalibrationSettings | None = None) -> None:
        self._settings = settings or CalibrationSettings()
        self._weight = 0.0
        self._variance = np.zeros(6)
        self.average = np.zeros(3)

    def calibrated(self, signals: Array, noise: Array, turned: Array, elapsed: float) -> tuple[Array, Array]:
        """Replaces specific force and angular acceleration by their conditional means.

        Args:
            signals: (12,), see `stadera.trunk.wrench.trunk_signals`.
            noise: (6,), variances of the first six.
            turned: (3, 3), rotates trunk components of a world-fixed vector from the last block to this one.
            elapsed: time since the last block [s].

        Returns:
            The signals (12,), and the part removed from the angular acceleration (3,) [rad/s²].
        """
        keep = exp(-elapsed / self._settings.memory)
        self._weight = keep * self._weight + 1.0 - keep
        share = (1.0 - keep) / self._weight
        force = signals[:3]
        carried = turned @ self.average
        most = self._settings.struck if share < 1.0 else np.inf  # the first block is all that is known
        self.average = carried + share * np.clip(force - carried, -most, most)
        mean = np.concatenate([self.average, np.zeros(3)])
        away = signals[:6] - mean
        self._variance += share * (away * away - self._variance)
        sure = self._variance > self._settings.beyond * noise
        gain = np.where(sure, 1.0 - noise / np.where(sure, self._variance, 1.0), 0.0)
        guess = mean + gain * away
        return np.concatenate([guess, signals[6:]]), (1.0 - gain[3:]) * away[3:]
