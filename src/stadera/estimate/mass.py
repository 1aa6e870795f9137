"""The trunk's mass in static equilibrium: the paper's eq. 7.

The ground carries the whole weight, so along the vertical u (trunk axes)

    m_r = u · Σ f_i / g,        m_tr = m_r - m_l

with m_l the mass of the leg links as believed. Samples at rest are averaged by a first-order low-pass that starts from
nothing (so that the first samples count fully); it starts anew after every motion.
"""

from __future__ import annotations

from math import exp, sqrt

import numpy as np
from numpy.typing import NDArray

from stadera.errors import StaderaError
from stadera.estimate.contact import ContactForces, Source
from stadera.estimate.forces import ContactForceEstimator
from stadera.estimate.measurement import Measurement
from stadera.estimate.protocol import Status, TrunkEstimate, unobserved
from stadera.estimate.stillness import GRAVITY, StillnessGate, StillnessLimits
from stadera.estimate.trunk import TrunkBounds, TrunkModel
from stadera.robot.model import Robot

Array = NDArray[np.float64]

_SETTLED = 3.0  # time constants of averaging, after which the estimate can count as converged
_FASTER = 5.0  # of the quicker average that a change shows up in first
_FIRST_STEP = 1e-3  # s, that the first sample after a restart counts for
_CHANGE = 1e-3  # share of the robot's mass by which the two averages may differ


class MassEstimator:
    """Weighs the trunk while the robot stands still; an `Estimator` of the mass alone.

    Args:
        robot: whose legs are believed in.
        start: what is believed at first; its centre of mass is carried along. None for the robot's own trunk.
        forces: source of contact forces; None for one of its own.
        limits: of standing still; None for the defaults.
        time_constant: of averaging [s].

    Raises:
        StaderaError: a time constant that is not positive.
    """

    def __init__(
        self,
        robot: Robot,
        start: TrunkModel | None = None,
        forces: ContactForceEstimator | None = None,
        limits: StillnessLimits | None = None,
        time_constant: float = 0.5,
    ) -> None:
        if not (np.isfinite(time_constant) and time_constant > 0):
            raise StaderaError(f"the averaging's time constant must be positive, got {time_constant} s")
        self.robot, self.forces = robot, forces or ContactForceEstimator(robot)
        self.gate = StillnessGate(self.forces.legs, limits)
        self.time_constant = time_constant
        self._bounds = TrunkBounds.of(robot)
        self._start = start or TrunkModel.prior(robot)
        self._mass = self._start.mass
        self._status, self._reason = Status.WAITING, ""
        self._learnt, self._before, self._averaged_variance = np.nan, np.nan, 0.0
        self._last: tuple[ContactForces, Array] | None = None
        self._since = np.nan
        self._weight = self._fast_weight = self._squared_weights = 0.0
        self._slow = self._fast = self._sample_variance = 0.0

    def update(self, measurement: Measurement) -> None:
        """Learns from a measurement at rest, refuses any other."""
        forces = self.forces.at(measurement)
        if reason := self.gate.complaint(measurement, forces):
            self._refuse(reason)
            self._restart()
            return
        up = measurement.up
        self._average(measurement.time, float(up @ forces.total_force) / GRAVITY)
        mass = self._slow - self.forces.legs.mass
        if not self._bounds.mass[0] <= mass <= self._bounds.mass[1]:
            self._refuse(f"the trunk's mass comes out as {mass:.2f} kg, which is not plausible")
            return
        self._mass = mass
        if self._sample_variance == 0.0:
            self._sample_variance = _mass_variance(forces, up, "white")
        self._averaged_variance = self._sample_variance * self._squared_weights
        self._learnt, self._last = measurement.time, (forces, up)
        rested = measurement.time - self._since >= _SETTLED * self.time_constant
        noise = sqrt(self._sample_variance * self._squared_weights * _FASTER)
        steady = abs(self._fast - self._slow) < _CHANGE * self.robot.mass + 3.0 * noise
        self._status, self._reason = Status.CONVERGED if rested and steady else Status.MOVING, ""

    def estimate(self) -> TrunkEstimate:
        """Mass with its variance; the centre of mass is not observed."""
        covariance = unobserved()
        if self._last is not None:
            forces, up = self._last
            constant = _mass_variance(forces, up, "constant") + _mass_variance(forces, up, "foot")
            covariance[0, 0] = constant + self._averaged_variance
        trunk = TrunkModel(self._mass, self._start.com_trunk, self._start.inertia_com)
        return TrunkEstimate(self._learnt, trunk, covariance, self._status, self._reason)

    def _average(self, time: float, mass: float) -> None:
        """One more sample into both averages; weights sum to one from the first sample on."""
        if np.isnan(self._since):
            self._since, self._before = time, time - _FIRST_STEP
        dt, self._before = time - self._before, time
        keep = exp(-dt / self.time_constant)
        self._weight = keep * self._weight + (1.0 - keep)
        share = (1.0 - keep) / self._weight
        self._squared_weights = (1.0 - share) ** 2 * self._squared_weights + share**2
        self._slow += share * (mass - self._slow)
        keep = exp(-dt * _FASTER / self.time_constant)
        self._fast_weight = keep * self._fast_weight + (1.0 - keep)
        self._fast += (1.0 - keep) / self._fast_weight * (mass - self._fast)

    def _restart(self) -> None:
        self._since = np.nan
        self._weight = self._fast_weight = self._squared_weights = 0.0
        self._slow = self._fast = self._sample_variance = 0.0

    def _refuse(self, reason: str) -> None:
        self._status, self._reason = Status.REFUSED, reason


def _mass_variance(forces: ContactForces, up: Array, source: Source) -> float:
    """Of u · Σ f / g [kg²]."""
    return float(up @ forces.wrench_covariance(source)[:3, :3] @ up) / GRAVITY**2
