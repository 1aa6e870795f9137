"""Passes an estimate to a controller only when it is accurate enough.

For a controller an outdated estimate is safer than one that has not converged. After a change of the load the error
bars are wide; until they are narrow again, the last sufficiently accurate estimate is returned, marked as refused.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from stadera.errors import StaderaError
from stadera.robot.model import Robot
from stadera.trunk.measurement import Measurement
from stadera.trunk.model import TrunkBounds, TrunkModel
from stadera.trunk.protocol import Estimator, Status, TrunkEstimate, unobserved


@dataclass(frozen=True)
class TrustLimits:
    """Accuracy required of a trunk estimate before a controller may use it.

    Attributes:
        mass: largest standard deviation of the mass [kg].
        com: largest standard deviation of the horizontal centre of mass [m].
    """

    mass: float
    com: float

    def __post_init__(self) -> None:
        if not min(self.mass, self.com) > 0:
            raise StaderaError(f"limits of trust must be positive, got {self.mass} kg and {self.com} m")

    @classmethod
    def of(cls, robot: Robot, mass: float = 0.12, com: float = 0.05) -> TrustLimits:
        """Shares of the robot's mass, and of its standing height.

        The usual ones are above the common error of all torques, which cancels for a controller that commands these
        same torques, and above the effect of static friction in a standing robot.
        """
        bounds = TrunkBounds.of(robot)
        return cls(mass * robot.mass, com * float(bounds.high[2] - bounds.low[2]))


class TrustedEstimator:
    """An `Estimator` that wraps another one, and returns only estimates that are plausible and within the limits.

    Args:
        inner: the wrapped estimator.
        robot: defines the plausible range.
        start: the estimate before the first accurate one; None for the robot's own trunk.
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
        """Passes the measurement to the inner estimator."""
        self.inner.update(measurement)

    def estimate(self) -> TrunkEstimate:
        """The inner estimate if it can be trusted; else the last trusted one, marked as refused with the reason."""
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
