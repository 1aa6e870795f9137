"""Settling time of a recursive estimate, and the criterion for convergence.

The update ĉ(k+1) = ĉ(k) + β (c - ĉ(k)) every T_s seconds leaves 1 - β of the error each time, so e^-3 (5 %) of it after
(the paper, below eq. 14)

    t_a = -3 T_s / ln(1 - β),        β = 1 - exp(-3 T_s / t_a)

Keeping t_a constant for any T_s makes an estimate independent of the sampling rate.

The paper calls an estimate converged when |c - ĉ|, the innovation, is below 0.0005 m (section V.C). The innovation of a
single sample is dominated by noise, so a running mean of it is compared, five times faster than the estimate. At low
rates even the mean has a noise of millimetres: the part within twice its standard deviation, from the scatter of the
innovations, is ignored. The estimate is then as close as the noise allows, which its covariance states.
"""

from __future__ import annotations

from math import exp, log

import numpy as np

from stadera.errors import ModelError, positive
from stadera.types import Array

STEP, PERIOD = 0.002, 0.001
"""α of the paper's approach (c), and the period [s] for which it is given."""

TOLERANCE = 0.0005
"""Limit of the innovation [m]: the paper's criterion."""


def settling_time(step: float = STEP, period: float = PERIOD) -> float:
    """Time [s] until 5 % of an error remains, for a step (0 to 1) every `period` [s].

    Raises:
        ModelError: the step is outside 0 to 1, or the period is not positive.
    """
    if not 0.0 < step < 1.0:
        raise ModelError(f"a step size lies between 0 and 1, got {step}")
    return -3.0 * positive("a period", period, "s", ModelError) / log(1.0 - step)


def step_size(settling: float, period: float) -> float:
    """The step (0 to 1) every `period` [s] that leaves 5 % of an error after `settling` [s]."""
    return 1.0 - exp(-3.0 * period / settling)


class Settled:
    """The paper's criterion: the running mean of the innovation is below the tolerance, apart from noise.

    Args:
        tolerance: in the innovation's unit.
        quicker: ratio of the running mean's rate to the estimate's.
        deviations: number of standard deviations of the mean that are attributed to noise.

    Raises:
        ModelError: the tolerance is not positive.
    """

    def __init__(self, tolerance: float = TOLERANCE, quicker: float = 5.0, deviations: float = 2.0) -> None:
        self.tolerance = positive("a tolerance", tolerance, error=ModelError)
        self._quicker, self._deviations = quicker, deviations
        self.restart()

    def restart(self) -> None:
        """Discards all innovations."""
        self._mean: Array | float = 0.0
        self._spread, self._noise, self._left = 0.0, 0.0, 1.0

    def take(self, innovation: Array, step: float) -> None:
        """Adds an innovation (k,); `step` is the estimate's own."""
        share = min(self._quicker * step, 1.0)
        away = innovation - self._mean
        self._mean = self._mean + share * away
        self._spread += share * ((1.0 - share) * float(away @ away) - self._spread)
        self._noise = self._spread * share / (2.0 - share)
        self._left *= 1.0 - share

    @property
    def reached(self) -> bool:
        """True if the estimate has settled; never before the mean covers a time constant."""
        if self._left >= exp(-1.0):
            return False
        return float(np.sum(np.square(self._mean))) < self.tolerance**2 + self._deviations**2 * self._noise
