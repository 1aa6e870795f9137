"""Protocol of the online estimators of the trunk, which process one measurement at a time.

An estimator never raises because of the robot's motion: it refuses a measurement with a reason, and keeps its last good
estimate.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Protocol, runtime_checkable

import numpy as np

from stadera.errors import StaderaError
from stadera.trunk.measurement import Measurement
from stadera.trunk.model import TrunkModel
from stadera.types import Array, Bools


class Status(StrEnum):
    """State of an estimator.

    `WAITING`: no estimate yet. `MOVING`: the estimate has not settled. `CONVERGED`: it has settled, by the method's own
    rule. `REFUSED`: the last measurement could not be used, for the stated reason.
    """

    WAITING = "waiting"
    MOVING = "moving"
    CONVERGED = "converged"
    REFUSED = "refused"


@dataclass(frozen=True, eq=False)
class TrunkEstimate:
    """An estimate of the trunk.

    Attributes:
        time: [s], of the last measurement used; NaN before the first.
        trunk: mass and centre of mass; components that were not observed keep their initial value.
        covariance: (4, 4) of mass [kg] and centre of mass [m]; rows and columns of what was not observed are NaN.
        status: see `Status`.
        reason: reason of a refusal, one sentence; otherwise empty.
    """

    time: float
    trunk: TrunkModel
    covariance: Array
    status: Status
    reason: str = ""

    def __post_init__(self) -> None:
        if self.covariance.shape != (4, 4):
            raise StaderaError(f"an estimate's covariance needs shape (4, 4), got {self.covariance.shape}")
        if (self.status is Status.REFUSED) != bool(self.reason):
            raise StaderaError(f"a refusal, and only a refusal, needs a reason; got {self.status}, {self.reason!r}")

    @property
    def value(self) -> Array:
        """Mass and centre of mass, (4,)."""
        return np.array([self.trunk.mass, *self.trunk.com_trunk])

    @property
    def std(self) -> Array:
        """Standard deviation of each component, NaN where not observed, (4,)."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def observed(self) -> Bools:
        """Whether each component was observed, (4,)."""
        return np.isfinite(np.diag(self.covariance))


def unobserved() -> Array:
    """Covariance of an estimate in which nothing was observed, (4, 4), all NaN."""
    return np.full((4, 4), np.nan)


@runtime_checkable
class Estimator(Protocol):
    """Protocol of all online estimators."""

    def update(self, measurement: Measurement) -> None:
        """Processes one measurement, or refuses it. Times must increase."""
        ...

    def estimate(self) -> TrunkEstimate:
        """The present estimate."""
        ...
