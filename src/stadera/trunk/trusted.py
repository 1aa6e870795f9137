"""What of an estimate is handed on to whoever walks by it: only what is known well enough.

A controller is better off with an old belief than with one that is still being found out. Right after a change of the
load an estimator's error bars are wide; until they are narrow again, the last estimate that was good enough is the
answer, marked as refused.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from stadera.errors import StaderaError
from stadera.robot.model import Robot
from stadera.trunk.measurement import Measurement
from stadera.trunk.model import TrunkBounds, TrunkModel
from stadera.trunk.protocol import Estimator, Status, TrunkEstimate, unobserved

# above what a common error of all torques leaves, which cancels for who commands these very torques, and what friction
# of a standing robot may hide
_MASS_SHARE = 0.12
_COM_SHARE = 0.05


@dataclass(frozen=True)
class TrustLimits:
    """How well a trunk must be known to be walked by.

    Attributes:
        mass: standard deviation of its mass [kg], at most.
        com: of its centre of mass ahead and aside [m], at most.
    """

    mass: float
    com: float

    def __post_init__(self) -> None:
        if not min(self.mass, self.com) > 0:
            raise StaderaError(f"limits of trust must be positive, got {self.mass} kg and {self.com} m")

    @classmethod
    def of(cls, robot: Robot) -> TrustLimits:
        """Twelve per cent of the robot's mass, and five of the height it stands at."""
        bounds = TrunkBounds.of(robot)
        return cls(_MASS_SHARE * robot.mass, _COM_SHARE * float(bounds.high[2] - bounds.low[2]))


class TrustedEstimator:
    """An `Estimator` that asks another one, and passes on what is inside the limits and plausible.

    Args:
        inner: fed with every measurement.
        robot: for what is plausible.
        start: the estimate until then; None for the robot's own trunk.
        limits: None for `TrustLimits.of(robot)`.
    """

    def __init__(
        self, inner: Estimator, robot: Robot, start: TrunkModel | None = None, limits: TrustLimits | None = None
    ) -> None:
        self.inner, self.limits = inner, limits or TrustLimits.of(robot)
        self._bounds = TrunkBounds.of(robot)
        trunk = start or TrunkModel.prior(robot)
        self._last = TrunkEstimate(np.nan, trunk, unobserved(), Status.WAITING)
        self._checked: TrunkEstimate | None = None

    def update(self, measurement: Measurement) -> None:
        """Passes it on."""
        self.inner.update(measurement)

    def estimate(self) -> TrunkEstimate:
        """The inner estimate if it can be trusted; else the last one that could, refused, and why."""
        estimate = self.inner.estimate()
        if estimate is self._checked:
            return self._last
        self._checked = estimate
        complaint = self._complaint(estimate)
        if complaint is None:
            self._last = estimate
        elif self._last.status is not Status.WAITING:
            self._last = replace(self._last, status=Status.REFUSED, reason=complaint)
        return self._last

    def _complaint(self, estimate: TrunkEstimate) -> str | None:
        if estimate.reason:
            return estimate.reason
        mass, x, y, _ = estimate.std
        if not mass <= self.limits.mass:
            return f"the trunk's mass is known to {mass:.2f} kg only, {self.limits.mass:.2f} kg are wanted"
        if not max(x, y) <= self.limits.com:
            return f"the trunk's centre of mass is known to {max(x, y):.3f} m only, {self.limits.com:.3f} m are wanted"
        return self._bounds.complaint(estimate.trunk)
