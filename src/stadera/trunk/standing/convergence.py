"""How fast a recursive estimate settles, and when it counts as settled.

The update ĉ(k+1) = ĉ(k) + β (c - ĉ(k)) every T_s seconds leaves 1 - β of the error each time, so e^-3 (5 %) of it after
(the paper, below eq. 14)

    t_a = -3 T_s / ln(1 - β),        β = 1 - exp(-3 T_s / t_a)

Keeping t_a and taking T_s as it comes makes an estimate independent of the rate it is fed at.

The paper calls an estimate converged when |c - ĉ|, the innovation, is below 0.0005 m (section V.C). One sample's
innovation is noise around that; what has to be below is a running mean of it, five times quicker than the estimate. At
low rates even the mean is noise of millimetres: what twice its standard deviation, by the innovations' own scatter,
explains does not count. An estimate is then as near as the noise lets it come, which its covariance says.
"""

from __future__ import annotations

from math import exp, isfinite, log

import numpy as np

from stadera.errors import ModelError
from stadera.types import Array

STEP, PERIOD = 0.002, 0.001
"""α of the paper's approach (c), and the period [s] it is used at."""

TOLERANCE = 0.0005
"""[m], of the innovation: the paper's rule."""


def settling_time(step: float = STEP, period: float = PERIOD) -> float:
    """Time [s] until 5 % of an error is left, at a step (0 to 1) every `period` [s].

    Raises:
        ModelError: a step outside 0 to 1, a period that is not positive.
    """
    if not 0.0 < step < 1.0:
        raise ModelError(f"a step size lies between 0 and 1, got {step}")
    return -3.0 * positive("period", period) / log(1.0 - step)


def step_size(settling: float, period: float) -> float:
    """The step (0 to 1) every `period` [s] that leaves 5 % of an error after `settling` [s]."""
    return 1.0 - exp(-3.0 * period / settling)


class Settled:
    """The paper's rule: the running mean of the innovation is below the tolerance, noise aside.

    Args:
        tolerance: in the innovation's unit.
        quicker: how much quicker the running mean is than the estimate.
        deviations: standard deviations of the mean by noise that do not count.

    Raises:
        ModelError: a tolerance that is not positive.
    """

    def __init__(self, tolerance: float = TOLERANCE, quicker: float = 5.0, deviations: float = 2.0) -> None:
        self.tolerance = positive("tolerance", tolerance)
        self._quicker, self._deviations = quicker, deviations
        self.restart()

    def restart(self) -> None:
        """Forgets all innovations."""
        self._mean: Array | float = 0.0
        self._spread, self._noise, self._left = 0.0, 0.0, 1.0

    def take(self, innovation: Array, step: float) -> None:
        """One more innovation (k,); `step` is the estimate's own."""
        share = min(self._quicker * step, 1.0)
        away = innovation - self._mean
        self._mean = self._mean + share * away
        self._spread += share * ((1.0 - share) * float(away @ away) - self._spread)
        self._noise = self._spread * share / (2.0 - share)
        self._left *= 1.0 - share

    @property
    def reached(self) -> bool:
        """Whether it has settled; not before the mean is of a time constant's innovations."""
        if self._left >= exp(-1.0):
            return False
        return float(np.sum(np.square(self._mean))) < self.tolerance**2 + self._deviations**2 * self._noise


def positive(name: str, value: float) -> float:
    """The value itself.

    Raises:
        ModelError: it is not positive and finite.
    """
    if not (isfinite(value) and value > 0):
        raise ModelError(f"a {name} must be positive, got {value}")
    return value
