"""What an estimator of the trunk is, at rest or moving; `weigh` and the laboratory know nothing else of it.

An estimator never raises because of the robot's motion: it refuses a measurement with a reason, and keeps its last good
estimate. One that takes a measurement at a time needs `update` and `estimate` only, and `StepEstimator` does the rest.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from traceback import extract_tb
from typing import TYPE_CHECKING, Protocol, runtime_checkable

import numpy as np

from stadera.errors import IdentificationError, StaderaError
from stadera.inertia import InertialParameters
from stadera.robot.model import Robot
from stadera.trunk.load import LoadChange, Payload, centre_slope
from stadera.trunk.measurement import Measurement
from stadera.trunk.model import TrunkModel
from stadera.trunk.result import ObservedLimits, TrunkParameters
from stadera.trunk.result import unobserved as unobserved
from stadera.trust import Trust
from stadera.types import Array, Bools

if TYPE_CHECKING:
    from stadera.trunk.samples import Samples


RUNS_AWAY = "the estimate runs away"
"""Beginning of the reason of a refusal because the estimate is none that a trunk can have."""


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


@runtime_checkable
class Estimator(Protocol):
    """What a class must do to be an estimator."""

    def update(self, measurement: Measurement) -> None:
        """Processes one measurement, or refuses it. Times must increase."""
        ...

    def estimate(self) -> TrunkEstimate:
        """The present estimate."""
        ...


@runtime_checkable
class Weigher(Estimator, Protocol):
    """All that is known of an estimator when a log is weighed by it; what it does not estimate is empty."""

    def add(self, samples: Samples | Sequence[Measurement]) -> None:
        """Processes any number of measurements, equivalent to as many calls of `update`."""
        ...

    @property
    def trunk(self) -> TrunkParameters:
        """The trunk, with all that is on it."""
        ...

    @property
    def payload(self) -> Payload | None:
        """Mass added since the tare; None without one."""
        ...

    @property
    def changes(self) -> tuple[LoadChange, ...]:
        """Changes of the load so far, in order."""
        ...

    @property
    def trust(self) -> Trust:
        """How well the model explains the measurements so far."""
        ...

    def tare(self) -> None:
        """Makes the present trunk the reference for `payload`."""
        ...


class StepEstimator(ABC):
    """A `Weigher` made of `update` and `estimate`.

    The payload is the difference of its estimates now and at the tare, whose errors count as independent. Subclasses
    set `robot`.
    """

    robot: Robot
    _tared: TrunkEstimate | None = None

    @abstractmethod
    def update(self, measurement: Measurement) -> None:
        """See `Estimator`."""

    @abstractmethod
    def estimate(self) -> TrunkEstimate:
        """See `Estimator`."""

    def add(self, samples: Samples | Sequence[Measurement]) -> None:
        """Processes any number of measurements."""
        for measurement in samples:
            self.update(measurement)

    def tare(self) -> None:
        """Makes the present estimate the reference for `payload`."""
        self._tared = self.estimate()

    @property
    def trunk(self) -> TrunkParameters:
        """The estimate, with the model's inertia."""
        found, inertia = self.estimate(), self.robot.inertias[self.robot.trunk].inertia_com
        body = InertialParameters.from_com(found.trunk.mass, found.trunk.com_trunk, inertia)
        observed = np.concatenate([found.observed, np.zeros(6, dtype=bool)])
        return TrunkParameters(body, found.covariance, np.full(6, np.nan), observed)

    @property
    def payload(self) -> Payload | None:
        """Difference from the tare; None without one."""
        if self._tared is None:
            return None
        (now, covariance), (before, earlier) = (self._moments(found) for found in (self.estimate(), self._tared))
        limit = np.full(3, ObservedLimits().com * self.robot.leg_length)
        return Payload.of_moments(now - before, covariance + earlier, limit)

    def _moments(self, found: TrunkEstimate) -> tuple[Array, Array]:
        """Mass and first moments (4,) of an estimate, and their covariance (4, 4)."""
        moments = found.value[0] * np.array([1.0, *found.value[1:]])
        unknown = np.full(4, (10.0 * self.robot.leg_length) ** 2)  # a centre that was not observed, nor is now
        seen, slope = found.observed, np.linalg.inv(centre_slope(moments))
        covariance = np.where(np.outer(seen, seen), np.nan_to_num(found.covariance), np.diag(~seen * unknown))
        return moments, slope @ covariance @ slope.T

    @property
    def changes(self) -> tuple[LoadChange, ...]:
        """None are detected."""
        return ()

    @property
    def trust(self) -> Trust:
        """Doubtful: nobody has evaluated this estimator's fit."""
        if self.estimate().status is Status.WAITING:
            return Trust("doubtful", np.nan, {}, ("too few samples yet for an estimate",))
        return Trust("doubtful", np.nan, {}, ("the fit of this estimator is not evaluated",))


class OwnEstimator(StepEstimator):
    """A user's object that has `update` and `estimate`."""

    def __init__(self, own: Estimator, robot: Robot) -> None:
        self.robot, self._own = robot, own

    def update(self, measurement: Measurement) -> None:
        """The user's own. IdentificationError: it fails."""
        try:
            self._own.update(measurement)
        except Exception as error:
            raise own_failure(type(self._own).__name__, error) from error

    def estimate(self) -> TrunkEstimate:
        """The user's own. IdentificationError: it fails, or is no `TrunkEstimate`."""
        name = type(self._own).__name__
        try:
            found = self._own.estimate()
        except Exception as error:
            raise own_failure(name, error) from error
        if not isinstance(found, TrunkEstimate):
            got = type(found).__name__
            raise IdentificationError(f"{name}.estimate() gave {got}, a stadera.trunk.protocol.TrunkEstimate is needed")
        return found


def own_failure(name: str, error: Exception) -> StaderaError:
    """What to raise when a user's estimator of this name fails."""
    if isinstance(error, StaderaError):
        return error
    place = extract_tb(error.__traceback__)[-1]
    inside = Path(place.filename).parent == Path(__file__).parent  # called with other arguments than it takes
    where = "" if inside else f" ({place.filename}, line {place.lineno})"
    return IdentificationError(f"the estimator {name} failed: {type(error).__name__}: {error}{where}")
