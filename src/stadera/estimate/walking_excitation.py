"""How much of the trunk's measured motion is motion, and how much is noise.

Least squares takes noise in its matrix for motion: of a robot that stands still it would learn inertia and height that
nothing shows, wrongly and ever surer. So an acceleration x measured with noise of variance n² enters the matrix as its
best guess (regression calibration),

    E[x | measured] = x̄ + g (x - x̄),      g = 1 - n² / var(x)

where that variance, over the last second, is beyond doubt, and g = 0 where it is not: what is not beyond the noise
shows nothing. x̄ is zero for the angular acceleration, and for the specific force its average over the last second
turned along with the trunk, which is gravity. The guess is right for Gaussian motion; of motion by fits and starts it
takes too much away from the fits, always with the same sign. So what it takes away of the angular acceleration is told
as doubtful, and counts as an error that is not sought (`stadera.estimate.square_root`).
"""

from __future__ import annotations

from math import exp

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_MEMORY = 1.0  # s
_BEYOND_DOUBT = 2.0  # times the noise's variance


class Excitation:
    """Takes noise out of the twelve signals of the trunk's rows, block by block."""

    def __init__(self) -> None:
        self._weight = 0.0
        self._variance = np.zeros(6)
        self._average = np.zeros(3)

    def calibrated(self, signals: Array, noise: Array, turned: Array, elapsed: float) -> tuple[Array, Array]:
        """The signals with specific force and angular acceleration as they most likely are, and what is doubtful of it.

        Args:
            signals: (12,), see `stadera.regressors.trunk_wrench.trunk_signals`.
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
        sure = self._variance > _BEYOND_DOUBT * noise
        gain = np.where(sure, 1.0 - noise / np.where(sure, self._variance, 1.0), 0.0)
        guess = mean + gain * away
        return np.concatenate([guess, signals[6:]]), (1.0 - gain[3:]) * away[3:]
