"""Base of the laws for a robot at rest: which measurements they learn from, the errors they state, what they say.

The trunk's mass is estimated in static equilibrium by the paper's eq. 7. The ground carries the whole weight, so
along the vertical u (trunk axes)

    m_r = u · Σ f_i / g,        m_tr = m_r - m_l

with m_l the mass of the leg links in the model, whose error enters the variance. Samples at rest are averaged by a
first-order low-pass that gives the first samples full weight and restarts after every motion.
"""

from abc import abstractmethod
from dataclasses import dataclass
from math import exp, isnan, sqrt
from typing import Any, ClassVar

import numpy as np

from stadera.constants import GRAVITY
from stadera.lab.laws.equilibrium import ForceNoise, NoisyForces, constant_errors_of, felt_by_mass, wrench_slope
from stadera.robot.model import Robot
from stadera.trunk.measurement import Measurement
from stadera.trunk.model import ImplausibleError, TrunkBounds, TrunkModel
from stadera.trunk.protocol import RUNS_AWAY, Status, StepEstimator, TrunkEstimate, unobserved
from stadera.trunk.standing.detection import StaticDetector, StaticLimits
from stadera.trunk.standing.forces import ContactForces
from stadera.types import Array


def stated_errors(robot: Robot, noise: ForceNoise) -> Array:
    """Standard deviations (k,) of the errors of `constant_errors_of`, which are independent; the vertical's is 0.2°."""
    places = constant_errors_of(robot)
    std = np.empty(len(places))
    std[places["torque"]], std[places["foot"]] = noise.torque_constant, noise.foot_position
    std[places["vertical"]], std[places["link_mass"]] = np.deg2rad(0.2), noise.leg_mass
    return np.maximum(std, 1e-9)


def white_covariance(forces: ContactForces, noise: ForceNoise) -> Array:
    """Covariance (6, 6) of the feet's wrench due to the torques' white noise."""
    scaled = wrench_slope(forces)[:, : len(forces.left)] * noise.torque_white
    return np.asarray(scaled @ scaled.T)


class StaticEstimator(StepEstimator):
    """Base of estimators at rest: selects measurements, keeps the last good estimate, and tells why others are refused.

    `start` is the initial estimate, None for the robot's own trunk; ImplausibleError if it lies outside
    `TrunkBounds.of(robot)`. `settings` are of the estimator's own kind, None for the defaults.
    """

    _WITHOUT_IMU = False  # whether its covariance includes a vertical computed from the forces
    kind: ClassVar[type[Any]]  # of the settings, which have the limits of standing `still`
    settings: Any

    def __init__(
        self, robot: Robot, start: TrunkModel | None = None, forces: NoisyForces | None = None, settings: Any = None
    ) -> None:
        self.robot, self.forces, self.settings = robot, forces or NoisyForces(robot), settings or self.kind()
        self._error_std = stated_errors(robot, self.forces.noise)
        self.bounds = TrunkBounds.of(robot)
        self.gate = StaticDetector(robot, self.settings.still)
        self._trunk = self._start = self.bounds.check(start or TrunkModel.prior(robot))
        self._status, self._reason = Status.WAITING, ""
        self._learnt, self._ran_away = np.nan, False
        self._begin()

    def _begin(self) -> None:
        """Prepares what an estimator keeps besides."""

    def update(self, measurement: Measurement) -> None:
        """Uses a measurement at rest; refuses any other and keeps its estimate."""
        if measurement.vertical_by_forces and not self._WITHOUT_IMU:
            name = type(self).__name__
            self._refuse(f"{name} needs an IMU: it takes the vertical for independent of the feet's forces")
            return
        if reason := self.gate.unusable(measurement):
            self._refuse(reason)
            return
        forces = self.forces.at(measurement)
        if reason := self.gate.complaint(measurement, forces):
            self._refuse(reason)
            self._interrupted()
            return
        if self._status is Status.REFUSED and not self._ran_away:
            self._status, self._reason = Status.WAITING if isnan(self._learnt) else Status.MOVING, ""
        self._learn(measurement, forces)

    def estimate(self) -> TrunkEstimate:
        """The present estimate; after a refusal the last good one, with the reason."""
        return TrunkEstimate(self._learnt, self._trunk, self._covariance(), self._status, self._reason)

    @abstractmethod
    def _learn(self, measurement: Measurement, forces: ContactForces) -> None:
        """Processes a measurement at rest."""

    @abstractmethod
    def _covariance(self) -> Array:
        """Covariance (4, 4) of mass and centre of mass."""

    def _interrupted(self) -> None:
        """Called after an interruption of rest."""

    def _refuse(self, reason: str) -> None:
        self._status, self._reason = Status.REFUSED, reason

    def _adopt(self, time: float, mass: float, com: Array, converged: bool) -> bool:
        """Makes mass [kg] and centre of mass (3,) [m] the estimate, unless they are implausible."""
        self._ran_away = True
        try:
            trunk = TrunkModel(mass, com, self._start.inertia_com)
        except ImplausibleError as error:
            self._refuse(f"{RUNS_AWAY}: {error}")
            return False
        if complaint := self.bounds.complaint(trunk):
            self._refuse(f"{RUNS_AWAY}: {complaint}")
            return False
        self._trunk, self._learnt, self._ran_away = trunk, time, False
        self._status, self._reason = Status.CONVERGED if converged else Status.MOVING, ""
        return True


@dataclass(frozen=True)
class MassSettings:
    """Settings of the average over samples, all positive."""

    time_constant: float = 0.5  # of averaging [s]
    settled: float = 3.0  # time constants at rest after which the estimate may count as converged
    faster: float = 5.0  # ratio of the rates of a second average, in which a change appears first, and the main one
    change: float = 1e-3  # difference of the two averages that counts as a change, as a share of the robot's mass
    first: float = 1e-3  # duration of the first sample after a restart [s]; any short one gives it its full weight
    still: StaticLimits | None = None  # limits of standing still; None for the usual ones


class MassEstimator(StaticEstimator):
    """Weighs the trunk while the robot stands still: an `Estimator` of the mass only; `start` supplies the centre of
    mass.
    """

    _WITHOUT_IMU, kind = True, MassSettings
    settings: MassSettings

    def _begin(self) -> None:
        self._last: tuple[ContactForces, Measurement] | None = None
        self._known: Array | None = None
        self._averaged_variance = self._slow = self._fast = self._sample_variance = 0.0
        self._interrupted()

    def _learn(self, measurement: Measurement, forces: ContactForces) -> None:
        time, up = measurement.time, measurement.up
        self._average(time, float(up @ forces.wrench[:3]) / GRAVITY)
        if self._sample_variance == 0.0:
            self._sample_variance = float(up @ white_covariance(forces, self.forces.noise)[:3, :3] @ up) / GRAVITY**2
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
                self._known[0, 0] = felt @ (self._error_std**2 * felt) + self._averaged_variance
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
