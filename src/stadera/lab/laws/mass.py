"""Estimates the trunk's mass in static equilibrium: the paper's eq. 7.

The ground carries the whole weight, so along the vertical u (trunk axes)

    m_r = u · Σ f_i / g,        m_tr = m_r - m_l

with m_l the mass of the leg links in the model, whose error enters the variance. Samples at rest are averaged by a
first-order low-pass that gives the first samples full weight and restarts after every motion.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from math import exp, sqrt

import numpy as np

from stadera.constants import GRAVITY
from stadera.errors import require_positive
from stadera.lab.laws.equilibrium import felt_by_mass
from stadera.lab.laws.static import StaticEstimator, stated_errors, white_covariance
from stadera.robot.model import Robot
from stadera.trunk.measurement import Measurement
from stadera.trunk.model import TrunkModel
from stadera.trunk.protocol import unobserved
from stadera.trunk.standing.forces import ContactForceEstimator, ContactForces
from stadera.types import Array


@dataclass(frozen=True)
class MassSettings:
    """Settings of the average over samples, all positive."""

    time_constant: float = 0.5  # of averaging [s]
    settled: float = 3.0  # time constants at rest after which the estimate may count as converged
    faster: float = 5.0  # ratio of the rates of a second average, in which a change appears first, and the main one
    change: float = 1e-3  # difference of the two averages that counts as a change, as a share of the robot's mass
    first: float = 1e-3  # duration of the first sample after a restart [s]; any short one gives it its full weight

    def __post_init__(self) -> None:
        require_positive("mass averaging's", self, (field.name for field in fields(self)))


class MassEstimator(StaticEstimator):
    """Weighs the trunk while the robot stands still: an `Estimator` of the mass only; `start` supplies the centre of
    mass. Arguments: see `RecursiveCom`.
    """

    _WITHOUT_IMU = True

    def __init__(
        self,
        robot: Robot,
        start: TrunkModel | None = None,
        forces: ContactForceEstimator | None = None,
        settings: MassSettings | None = None,
    ) -> None:
        super().__init__(robot, start, forces)
        self.settings = settings or MassSettings()
        self._errors = stated_errors(robot, self.forces.noise)
        self._last: tuple[ContactForces, Measurement] | None = None
        self._known: Array | None = None
        self._averaged_variance = self._slow = self._fast = self._sample_variance = 0.0
        self._interrupted()

    def _learn(self, measurement: Measurement, forces: ContactForces) -> None:
        time, up = measurement.time, measurement.up
        self._average(time, float(up @ forces.wrench[:3]) / GRAVITY)
        if self._sample_variance == 0.0:
            self._sample_variance = float(up @ white_covariance(forces)[:3, :3] @ up) / GRAVITY**2
        rested = time - self._since >= self.settings.settled * self.settings.time_constant
        noise = sqrt(self._sample_variance * self._squared_weights * self.settings.faster)
        steady = abs(self._fast - self._slow) < self.settings.change * self.robot.mass + 3.0 * noise
        if self._adopt(time, self._slow - self.forces.leg_mass, self._start.com_trunk, rested and steady):
            self._last, self._known = (forces, measurement), None
            self._averaged_variance = self._sample_variance * self._squared_weights

    def _covariance(self) -> Array:
        """The centre of mass is not observed."""
        if self._known is None:
            self._known = unobserved()
            if self._last is not None:
                felt = felt_by_mass(*self._last, self.robot)
                self._known[0, 0] = felt @ self._errors.covariance @ felt + self._averaged_variance
        return self._known

    def _interrupted(self) -> None:
        self._since, self._before = np.nan, np.nan
        self._weight = self._fast_weight = self._squared_weights = 0.0
        self._slow = self._fast = self._sample_variance = 0.0

    def _average(self, time: float, mass: float) -> None:
        """Adds a sample to both averages; weights sum to one from the first sample on."""
        if np.isnan(self._since):
            self._since, self._before = time, time - self.settings.first
        dt, self._before = time - self._before, time
        keep = exp(-dt / self.settings.time_constant)
        self._weight = keep * self._weight + (1.0 - keep)
        share = (1.0 - keep) / self._weight
        self._squared_weights = (1.0 - share) ** 2 * self._squared_weights + share**2
        self._slow += share * (mass - self._slow)
        keep = exp(-dt * self.settings.faster / self.settings.time_constant)
        self._fast_weight = keep * self._fast_weight + (1.0 - keep)
        self._fast += (1.0 - keep) / self._fast_weight * (mass - self._fast)
